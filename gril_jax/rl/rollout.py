"""Many environments stepped together by one compiled call, with a pool of starts beside them.

A reset costs as much as some control steps, and an episode needs one start in its whole length. So
each update draws only as many starts as episodes will end in it, and puts them into a pool from
which a lane that ends takes its next start. Every start is drawn by the task's own `reset`; there
is one place in the program where the simulator steps and one where it resets.

Shapes use B for environments and T for the control steps between two updates.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key, PRNGKeyArray

from . import blocks
from .episodes import Episodes, Lane, Moment, reset_where

__all__ = ["Fleet", "Steps", "init", "renew", "renewals", "scatter", "summary", "unroll"]

# (observations (B, O), key) -> actions (B, A) and what else the learner keeps of each.
Act = Callable[[Float[Array, "B O"], PRNGKeyArray], tuple[Float[Array, "B A"], Any]]


class Fleet(NamedTuple):
    """B environments and the starts that they will take up."""

    lanes: Lane  # (B, ...)
    starts: Lane  # (B, ...): the pool
    drawn: Int[Array, ""]  # how often the pool has been renewed in part


class Steps(NamedTuple):
    """What T control steps of B environments brought, (T, B, ...)."""

    observation: Float[Array, "T B O"]
    action: Float[Array, "T B A"]
    extras: Any  # of `Act`
    moment: Moment
    last: Float[Array, "T B O"]  # the observation after the step, before any reset
    ended: Bool[Array, "T B"]
    kept: Any  # what else was asked for of the lane after the step, before any reset


def init(episodes: Episodes, keys: Key[Array, "K"]) -> Fleet:
    """B environments at the start of an episode, with a full pool of starts, from 2 B keys (K,)."""
    num_envs = len(keys) // 2
    both = jax.vmap(episodes.begin)(keys)
    # A task's own weak types would become strong in the first step, which then compiles twice.
    both = jax.tree.map(_strong, both)
    lanes = jax.tree.map(lambda x: x[:num_envs], both)
    starts = jax.tree.map(lambda x: x[num_envs:], both)
    return Fleet(lanes, starts, jnp.zeros((), jnp.int32))


def _strong(x: Array) -> Array:
    return x.astype(x.dtype) if getattr(x, "weak_type", False) else x  # keys have no such thing


def scatter(fleet: Fleet, key: PRNGKeyArray, episode_length: int) -> Fleet:
    """The same environments, said to be at random times of their episodes.

    Were all episodes to begin together, every batch would hold one phase of the task only.
    """
    # `randint` would take three draws.
    share = jax.random.uniform(key, fleet.lanes.time.shape)
    time = jnp.minimum((share * episode_length).astype(jnp.int32), episode_length - 1)
    return fleet._replace(lanes=fleet.lanes._replace(time=time))


def renewals(num_envs: int, unroll_length: int, episode_length: int) -> int:
    """Starts to draw for each unroll: at least as many as time limits will use up.

    The number divides `num_envs`, so that parts of the pool never overlap; all blocks of it get the
    same.
    """
    parts = blocks.count(num_envs)
    size = num_envs // parts
    needed = min(size, math.ceil(size * unroll_length / episode_length))
    return parts * next(n for n in range(needed, size + 1) if size % n == 0)


def renew(episodes: Episodes, fleet: Fleet, keys: Key[Array, "R"]) -> Fleet:
    """The fleet with the oldest starts of its pool drawn anew, one with each of the keys (R,).

    Each block of the pool gets its share of them; R is what `renewals` says, or another number that
    the blocks can share and that divides the pool.
    """
    num_envs = len(fleet.lanes.time)
    parts = blocks.count(num_envs)
    fresh = blocks.split(jax.vmap(episodes.begin)(keys), parts)
    place = (fleet.drawn * (len(keys) // parts)) % (num_envs // parts)

    def put(pool, new):
        return jax.lax.dynamic_update_slice_in_dim(pool, new, place, 1)

    starts = jax.tree.map(put, blocks.split(fleet.starts, parts), fresh)
    return fleet._replace(starts=blocks.join(starts), drawn=fleet.drawn + 1)


def unroll(
    episodes: Episodes,
    reward_params: Any,
    fleet: Fleet,
    act: Act,
    keys: Key[Array, "T"],
    *,
    tau: Float[Array, ""] | float,
    keep: Callable[[Lane], Any] = lambda lane: (),
) -> tuple[Fleet, Steps]:
    """A control step of every environment with each of the keys (T,).

    A lane that ends takes a start of the pool.

    Should it end twice in one unroll, it takes the same start twice. From unroll to unroll each
    block of the pool is turned by one place, so that a lane whose episodes end early meets other
    starts. `keep` says what of a lane becomes part of `Steps`.
    """
    starts = _turned(fleet)

    def one(lane, action):
        return episodes.advance(reward_params, lane, action, tau=tau)

    def move(lanes, key_step):
        observation = jax.vmap(episodes.observe)(lanes)
        action, extras = act(observation, key_step)
        lanes, moment = jax.vmap(one)(lanes, action)
        last, kept = jax.vmap(lambda lane: (episodes.observe(lane), keep(lane)))(lanes)
        ended = moment.terminated + moment.truncated > 0
        lanes = jax.vmap(reset_where)(ended, starts, lanes)
        return lanes, Steps(observation, action, extras, moment, last, ended, kept)

    lanes, steps = jax.lax.scan(move, fleet.lanes, keys)
    return fleet._replace(lanes=lanes), steps


def _turned(fleet: Fleet) -> Lane:
    """The start that waits for each lane, (B, ...): in its block, so many places on as `drawn`."""
    num_envs = len(fleet.lanes.time)
    parts = blocks.count(num_envs)
    size = num_envs // parts
    turned = (jnp.arange(size) + fleet.drawn) % size
    pool = blocks.split(fleet.starts, parts)
    return blocks.join(jax.tree.map(lambda x: x[:, turned], pool))


def summary(steps: Steps) -> dict[str, Float[Array, ""]]:
    """Means over the unroll; the task's own metrics over the episodes that ended in it.

    Only episodes from the task's own starts count for these; `episodes` is how many.
    """
    moment = steps.moment
    own = steps.ended * (1.0 - moment.metrics.get("varied", jnp.zeros_like(moment.reward)))
    episodes = jnp.sum(own)
    metrics = {
        name: jnp.sum(own * value) / jnp.maximum(episodes, 1.0)
        for name, value in moment.metrics.items()
        if name != "varied"
    }
    return metrics | {
        "episodes": episodes,
        "reward": jnp.mean(moment.reward),
        "nonfinite": jnp.sum(moment.nonfinite),
    }
