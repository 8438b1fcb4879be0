"""The states that an audit makes around its starts, the same for all rewards, and their rewards.

Shapes use B for starts, S for the states of a battery, W for successes, V for those to follow
uphill, M for objects that can move and G for a side of a grid.
"""

import functools
import itertools
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from .scene_reward import Scene, SceneReward, StagedTask, alone, pushed
from .shortfalls import UNCLEAR, is_clear_success, kind_of
from .states import FACTORS, Battery, battery, successes

_SIDE = 25
_FOLLOWED = 64  # sampled successes
_TOGETHER = 256  # states side by side


class Judged(NamedTuple):
    """States with their true progress and their kind of shortfall."""

    scene: Scene
    score: Float[Array, "*S"]
    kind: Int[Array, "*S"]  # index into KINDS, or UNCLEAR

    @property
    def nothing(self) -> Bool[Any, "*S"]:
        """True for shortfalls without progress."""
        return (self.kind != UNCLEAR) & (self.score <= 0)


class States(NamedTuple):
    """All states that do not depend on the reward; leading axis B."""

    battery: Battery
    kind: Int[Array, "*B S"]  # of the battery's states: index into KINDS, or UNCLEAR
    clear: Bool[Array, "*B S"]  # which of the battery's states are clear successes
    alone: Judged  # (2, M, G, G): each object swept over the plane, from the start and from success
    pushed: Judged  # (G, G): all targets side by side
    successes: Scene  # (W,): sampled from all of them
    succeeds: Bool[Array, "*B W"]  # which samples are clear successes
    followed: Int[Array, "*B V"]  # samples to follow uphill, clear successes first

    def judged(self) -> tuple[Judged, Judged, Judged]:
        """The states of battery, sweeps and pushes."""
        made = Judged(self.battery.scenes, self.battery.score, self.kind)
        return made, self.alone, self.pushed


class Rewards(NamedTuple):
    """The reward of each of the `States`."""

    battery: Float[Array, "B S"]
    alone: Float[Array, "B 2 M G G"]
    pushed: Float[Array, "B G G"]
    successes: Float[Array, "B W"]


def make_states(key: PRNGKeyArray, start: Scene, *, task: StagedTask, side: int = _SIDE) -> States:
    """Makes all states around the state after a reset; batch with `jax.vmap`.

    `side` is that of the grids. The key is consumed.
    """
    made = battery(key, task, start)
    success = made.scenes.center[jnp.argmax(made.factor == FACTORS.index("success"))]
    sweep = jax.vmap(lambda center: alone(task, start, center, side=side))
    sampled = successes(jax.random.fold_in(key, 1), task, start)
    clear = jax.vmap(lambda center: is_clear_success(task, start, center))
    succeeds = clear(sampled.center)

    def judged(scenes):
        of = lambda c, a: (task.progress(c, start.size), kind_of(task, start, c, a))  # noqa: E731
        return Judged(scenes, *jnp.vectorize(of, signature="(n,k),(n)->(),()")(
            scenes.center, scenes.active
        ))  # fmt: skip

    return States(
        made, judged(made.scenes).kind, clear(made.scenes.center),
        judged(sweep(jnp.stack([start.center, success]))), judged(pushed(task, start, side=side)),
        sampled, succeeds, jnp.argsort(~succeeds)[:_FOLLOWED],
    )  # fmt: skip


def rewards_of(reward: SceneReward, params: Any, states: States) -> Rewards:
    """Evaluates the reward at every state."""
    parts = (*(made.scene for made in states.judged()), states.successes)
    shapes = [scenes.active.shape[:-1] for scenes in parts]
    sizes = [math.prod(shape) for shape in shapes]
    padding = -sum(sizes) % _TOGETHER  # a remainder would be a program of its own

    def flat(*leaves):
        each = zip(leaves, sizes, shapes, strict=True)
        joined = jnp.concatenate([x.reshape(n, *x.shape[len(s) :]) for x, n, s in each])
        return jnp.concatenate([joined, jnp.repeat(joined[:1], padding, axis=0)])

    every, one = jax.tree.map(flat, *parts), functools.partial(reward, params)
    paid = jax.lax.map(one, every, batch_size=_TOGETHER)
    ends = list(itertools.accumulate(sizes))
    return Rewards(*(x.reshape(s) for x, s in zip(jnp.split(paid, ends), shapes, strict=False)))
