"""The adversary: gradient ascent of a reward over object positions, without any progress.

A policy that is paid by a learned reward climbs it. So does this, without a simulator: from many
random states whose true progress is 0, along the reward's own gradient, to the best-paid state with
true progress 0. What it finds need not be reachable: blocks may overlap each other and the robot,
which leaves out no state that physics allows; they have the sizes that the task says of them there,
and stay on the plane.

An object either moves, and then its activity bit is set, or rests where the episode began, and then
its bit is drawn at random. Shapes use N for objects and A for ascents.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from .scene_reward import Scene, SceneReward, StagedTask, can_move

_FIRST, _LAST = 0.15, 0.002  # length of a step, in half extents of the plane
_LANES = 50  # ascents side by side: their activations should fit into a CPU's cache


class Found(NamedTuple):
    """The best-paid state of each ascent; an ascent stops at a non-finite reward, and keeps it."""

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
    """Runs many ascents from varied states around one start; one compiled program under `jax.jit`.

    Each object goes the same distance along its own gradient, one axis at a time. What would leave
    the plane is cut off, and what would achieve something is not done, so that an object slides
    along the edge of where it would count.

    Args:
      reward: of one state, differentiable in its centres.
      params: the reward's parameters; may be mapped over with `jax.vmap`.
      key: consumed.
      task, start: the state after a reset of this task, with true progress 0.
      ascents, steps: how many, and how many steps of each, getting shorter; static.
    """

    def one(key):
        limit = task.limit(start.size)
        scene, moves = _begin(key, task, start, limit)
        lengths = jnp.geomspace(_FIRST, _LAST, steps) * task.half_extent

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
            return (_without_progress(task, start, center, goal), keep(best, center, paid)), None

        never = (scene.center, jnp.full_like(value(scene.center), -jnp.inf))
        (_, (center, paid)), _ = jax.lax.scan(climb, (scene.center, never), lengths)
        return Found(at(center), paid)

    lanes = next(n for n in range(_LANES, 0, -1) if ascents % n == 0)
    return jax.lax.map(one, jax.random.split(key, ascents), batch_size=lanes)


def _begin(key, task, start, limit):
    """A random state without progress, and a mask of the objects that move."""
    keys = jax.random.split(key, 4)
    able = can_move(task, start)
    share = jax.random.uniform(keys[0])
    moves = able & (jax.random.uniform(keys[1], able.shape) < share)
    anywhere = jax.random.uniform(keys[2], start.center.shape, minval=-limit, maxval=limit)
    goal = jnp.where(moves[:, None], anywhere, start.center)
    touched = able & jax.random.bernoulli(keys[3], 0.5, able.shape)
    active = moves | touched
    active |= start.is_robot & active.any()
    center = _without_progress(task, start, start.center, goal)
    return start._replace(center=center, active=active), moves


def _without_progress(task, start, center, goal):
    """Moves towards `goal` one coordinate at a time, skipping those that would bring progress."""

    def go(center, at):
        moved = center.at[at[0], at[1]].set(goal[at[0], at[1]])
        nothing = task.progress(moved, start.size) <= 0
        return jnp.where(nothing, moved, center), None

    numbers = [(i, axis) for i in (*task.movable, *task.robots) for axis in range(2)]
    return jax.lax.scan(go, center, jnp.array(numbers))[0]
