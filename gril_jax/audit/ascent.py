"""An adversarial gradient search for object positions with a high reward and no progress.

A policy increases a learned reward. The search does the same without a simulator. It starts from
many states with true progress 0 and follows the reward's gradient, but makes no progress. Half of
the initial states are random. The other half are on the brink of success: targets stand just
outside of where they would count.

The states that it finds need not be reachable. Blocks may overlap each other and the robot, so no
state that physics allows is left out. They have the sizes that the task says of them there. They
stay on the plane, and where the task's mechanics allow, such as on their rails.

An object either moves, and then its activity bit is set, or rests where the episode began, and then
its bit is sampled at random. Shapes use N for objects and A for searches.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from .scene_reward import Scene, SceneReward, StagedTask, can_move

_FIRST, _LAST = 0.15, 0.002  # length of a step, in half extents of the plane
_LEGS, _LATER = 2, 0.3  # of a search; the last one's steps, relative to the first one's
_ASIDE = 0.05  # half extents, standard deviation: what a leg begins aside of the best state so far
_HALVINGS = 16  # of the way to a success, until its brink
_LANES = 50  # searches side by side: their activations should fit into a CPU's cache


class Found(NamedTuple):
    """The state of highest reward of each search; a non-finite reward ends it, and is kept."""

    scene: Scene  # leading axis A
    reward: Float[Array, "*A"]


def search(
    reward: SceneReward,
    params: Any,
    key: PRNGKeyArray,
    task: StagedTask,
    start: Scene,
    *,
    ascents: int = 1000,
    steps: int = 100,
) -> Found:
    """Searches from many states around one start; one compiled program under `jax.jit`.

    Each object goes the same distance along its own gradient, one axis at a time. Objects stay on
    the plane, and steps that would make progress are left out. So an object slides along the edge
    of where it would count. The second half of the steps begins a little aside of the best state of
    the first.

    Args:
      reward: of one state, differentiable in its centres.
      params: the reward's parameters; may be mapped over with `jax.vmap`.
      key: consumed.
      task, start: the state after a reset of this task, with true progress 0.
      ascents: number of searches; static.
      steps: of each search in all, getting shorter; static.
    """

    def one(key):
        limit = task.limit(start.size)
        key_begin, key_legs = jax.random.split(key)
        scene, moves = _begin(key_begin, task, start, limit)
        lengths = jnp.geomspace(_FIRST, _LAST, -(-steps // _LEGS)) * task.half_extent
        lengths = jnp.outer(jnp.geomspace(1.0, _LATER, _LEGS), lengths)

        def at(center):
            return scene._replace(center=center, size=task.sizes(center, start.size))

        def value(center):
            return reward(params, at(center))

        def keep(best, center, paid):
            better = (paid > best[1]) | ~jnp.isfinite(paid)
            return jax.tree.map(lambda new, old: jnp.where(better, new, old), (center, paid), best)

        def climb(carry, length):
            center, best = carry
            paid, slope = jax.value_and_grad(value)(center)
            steepness = jnp.sqrt(jnp.sum(slope**2, axis=1, keepdims=True) + 1e-20)
            step = jnp.where(moves[:, None] & jnp.isfinite(slope), length * slope / steepness, 0.0)
            goal = jnp.clip(center + step, -limit, limit)
            return (_towards(task, start, center, goal), keep(best, center, paid)), None

        def leg(best, of):
            key, lengths, aside = of
            there = best[0] + aside * jax.random.normal(key, best[0].shape)
            there = jnp.clip(jnp.where(moves[:, None], there, best[0]), -limit, limit)
            there = _towards(task, start, best[0], there)
            (_, best), _ = jax.lax.scan(climb, (there, best), lengths)
            return best, None

        never = (scene.center, jnp.full_like(value(scene.center), -jnp.inf))
        aside = jnp.where(jnp.arange(_LEGS) > 0, _ASIDE * task.half_extent, 0.0)
        keys = jax.random.split(key_legs, _LEGS)
        (center, paid), _ = jax.lax.scan(leg, never, (keys, lengths, aside))
        return Found(at(center), paid)

    lanes = next(n for n in range(_LANES, 0, -1) if ascents % n == 0)
    return jax.lax.map(one, jax.random.split(key, ascents), batch_size=lanes)


def _begin(key, task, start, limit):
    """A random state without progress, or a brink of success, and a mask of the objects that move.

    A brink is the last state without progress on a straight way from the random state to a success.
    """
    keys = jax.random.split(key, 6)
    able = can_move(task, start)
    share = jax.random.uniform(keys[0])
    moves = able & (jax.random.uniform(keys[1], able.shape) < share)
    anywhere = jax.random.uniform(keys[2], start.center.shape, minval=-limit, maxval=limit)
    goal = jnp.where(moves[:, None], anywhere, start.center)
    center = _towards(task, start, start.center, goal)
    brink = jax.random.bernoulli(keys[4])
    success = task.fulfil(keys[5], center, start.size)
    center = jnp.where(brink, _brink(task, start, center, success), center)
    moves |= brink & (success != center).any(axis=1)
    touched = able & jax.random.bernoulli(keys[3], 0.5, able.shape)
    active = moves | touched
    active |= start.is_robot & active.any()
    return start._replace(center=center, active=active), moves


def _brink(task, start, outside, success):
    """Halves the way between a state without progress and a success until both ends meet."""

    def halve(ends, _):
        low, high = ends
        middle = (low + high) / 2
        center = outside + middle * (success - outside)
        nothing = task.progress(center, start.size) <= 0
        return (jnp.where(nothing, middle, low), jnp.where(nothing, high, middle)), None

    (share, _), _ = jax.lax.scan(halve, (jnp.float32(0), jnp.float32(1)), length=_HALVINGS)
    return _if_possible(task, start, outside, outside + share * (success - outside))


def _towards(task, start, center, goal):
    """Moves towards `goal` without progress, and only to where the scene's mechanics allow."""
    goal = task.possible(goal, start.size)
    return _if_possible(task, start, center, _without_progress(task, start, center, goal))


def _if_possible(task, start, center, there):
    """The nearest possible centres to `there`; these ones if there would be progress."""
    there = task.possible(there, start.size)
    return jnp.where(task.progress(there, start.size) <= 0, there, center)


def _without_progress(task, start, center, goal):
    """Moves towards `goal` one coordinate at a time, skipping those that would bring progress."""

    def go(center, at):
        moved = center.at[at[0], at[1]].set(goal[at[0], at[1]])
        nothing = task.progress(moved, start.size) <= 0
        return jnp.where(nothing, moved, center), None

    numbers = [(i, axis) for i in (*task.movable, *task.robots) for axis in range(2)]
    return jax.lax.scan(go, center, jnp.array(numbers))[0]
