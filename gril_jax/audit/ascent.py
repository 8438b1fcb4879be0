"""An adversarial gradient search for object positions with a high reward and no success.

A policy increases a learned reward. The search does the same without a simulator. It starts from
many states that fall short of success (`gril_jax.audit.beginnings`), follows the reward's gradient,
and never comes to a success. Of each kind of shortfall it keeps the state of highest reward.

The states that it finds need not be reachable. Blocks may overlap each other and the robot, so no
state that physics allows is left out. They have the sizes that the task says of them there. They
stay on the plane, and where the task's mechanics allow, such as on their rails.

Shapes use N for objects, A for searches, K for kinds of shortfall and W for successes.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from .beginnings import beginning, towards
from .scene_reward import Scene, SceneReward, StagedTask, can_move
from .shortfalls import KINDS, kind_of
from .states import SUCCESS

_FIRST, _LAST = 0.15, 0.002  # length of a step, in half extents of the plane
_LEGS, _LATER = 2, 0.3  # of a search; the last one's steps, relative to the first one's
_ASIDE = 0.05  # half extents, standard deviation: what a leg begins aside of the best state so far
_AWAY = 0.05  # half extents: the first step from a success
_KEEPING = 50  # steps from a success
_LANES = 50  # searches side by side: their activations should fit into a CPU's cache


class Found(NamedTuple):
    """The state of highest reward of each kind of shortfall in each search.

    Where a search met no clear state of a kind, the reward is -inf. A non-finite reward is kept.
    """

    scene: Scene  # leading axes A, K
    score: Float[Array, "*A K"]  # true progress
    reward: Float[Array, "*A K"]


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

    Each object goes the same distance along its own gradient, and slides along the edge of where it
    would count. The second half of the steps begins a little aside of the best state of the first.

    Args:
      reward: of one state, differentiable in its centres.
      params: the reward's parameters; may be mapped over with `jax.vmap`.
      key: consumed.
      task, start: the state after a reset of this task, with true progress 0.
      ascents: number of searches; static.
      steps: of each search in all, getting shorter; static.
    """
    limit = task.limit(start.size)
    lengths = jnp.geomspace(_FIRST, _LAST, -(-steps // _LEGS)) * task.half_extent
    lengths = jnp.outer(jnp.geomspace(1.0, _LATER, _LEGS), lengths)
    asides = jnp.where(jnp.arange(_LEGS) > 0, _ASIDE * task.half_extent, 0.0)

    def one(key):
        key_begin, key_legs = jax.random.split(key)
        scene, moves, most = beginning(key_begin, task, start)
        value = lambda center: reward(params, _at(task, start, scene, center))  # noqa: E731

        def keep(best, center, paid):
            kind = kind_of(task, start, center, scene.active)
            better = (jnp.arange(len(KINDS)) == kind) & ((paid > best[1]) | ~jnp.isfinite(paid))
            centers = jnp.where(better[:, None, None], center, best[0])
            return centers, jnp.where(better, paid, best[1])

        def climb(carry, length):
            center, best = carry
            paid, goal = _uphill(value, center, moves, length, limit)
            return (towards(task, start, center, goal, most), keep(best, center, paid)), None

        def leg(best, of):
            key, lengths, aside = of
            center = best[0][jnp.argmax(best[1])]
            there = center + aside * jax.random.normal(key, center.shape)
            there = jnp.clip(jnp.where(moves[:, None], there, center), -limit, limit)
            there = towards(task, start, center, there, most)
            (_, best), _ = jax.lax.scan(climb, (there, best), lengths)
            return best, None

        first = jnp.broadcast_to(scene.center, (len(KINDS), *scene.center.shape))
        none = jnp.full(len(KINDS), -jnp.inf, value(scene.center).dtype)
        keys = jax.random.split(key_legs, _LEGS)
        (centers, paid), _ = jax.lax.scan(leg, (first, none), (keys, lengths, asides))
        scenes = jax.vmap(lambda center: _at(task, start, scene, center))(centers)
        return Found(scenes, jax.vmap(lambda c: task.progress(c, start.size))(centers), paid)

    return jax.lax.map(one, jax.random.split(key, ascents), batch_size=_lanes(ascents))


def kept(
    reward: SceneReward, params: Any, task: StagedTask, start: Scene, successes: Scene
) -> Bool[Array, "W"]:
    """True for successes from which the reward leads uphill to a success.

    All objects that have moved follow the gradient freely for 50 steps; the state of highest reward
    on the way counts.
    """
    limit = task.limit(start.size)
    lengths = jnp.geomspace(_AWAY, _LAST, _KEEPING) * task.half_extent

    def one(scene):
        moves = can_move(task, start) & scene.active

        def climb(carry, length):
            center, best = carry
            paid, goal = _uphill(
                lambda c: reward(params, _at(task, start, scene, c)), center, moves, length, limit
            )
            best = jax.tree.map(lambda a, b: jnp.where(paid > best[1], a, b), (center, paid), best)
            return (task.possible(goal, start.size), best), None

        never = (scene.center, jnp.full_like(reward(params, scene), -jnp.inf))
        (_, (center, _)), _ = jax.lax.scan(climb, (scene.center, never), lengths)
        return task.progress(center, start.size) >= SUCCESS

    return jax.lax.map(one, successes, batch_size=_lanes(len(successes.center)))


def _at(task, start, scene, center) -> Scene:
    return scene._replace(center=center, size=task.sizes(center, start.size))


def _uphill(value, center, moves, length, limit):
    """The reward, and the centres one step up its gradient, each object's of the same length."""
    paid, slope = jax.value_and_grad(value)(center)
    steepness = jnp.sqrt(jnp.sum(slope**2, axis=1, keepdims=True) + 1e-20)
    step = jnp.where(moves[:, None] & jnp.isfinite(slope), length * slope / steepness, 0.0)
    return paid, jnp.clip(center + step, -limit, limit)


def _lanes(count: int) -> int:
    """The most searches side by side that leave no remainder, a program of its own."""
    return next(n for n in range(_LANES, 0, -1) if count % n == 0)
