"""Rollouts of many environments in one compiled call, with a pool of starts beside them.

A reset costs as much as some control steps, and an episode needs one start in its whole length. So
each update samples only as many starts as episodes will end in it, and puts them into a pool from
which an environment takes its next start. Every start is sampled by the task's own `reset`; there
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
from .episodes import Episodes, EpisodeState, StepResult, reset_where

# (observations (B, O), key) -> actions (B, A) and what else the learner keeps of each.
Act = Callable[[Float[Array, "B O"], PRNGKeyArray], tuple[Float[Array, "B A"], Any]]


class VectorState(NamedTuple):
    """State of B vectorised environments, and a pool of starts."""

    running: EpisodeState  # (B, ...)
    starts: EpisodeState  # (B, ...): the pool
    drawn: Int[Array, ""]  # how often the pool has been renewed in part


class Rollout(NamedTuple):
    """Rollout of T control steps of B environments, (T, B, ...)."""

    observation: Float[Array, "T B O"]
    action: Float[Array, "T B A"]
    extras: Any  # of `Act`
    result: StepResult
    last: Float[Array, "T B O"]  # the observation after the step, before any reset
    ended: Bool[Array, "T B"]


def init(episodes: Episodes, keys: Key[Array, "K"]) -> VectorState:
    """B environments at an episode's start, with a full pool of starts, from 2 B keys (K,).

    A start that the policy would see as NaN or infinite is replaced by the first other one.
    """
    num_envs = len(keys) // 2
    both = jax.vmap(episodes.begin)(keys)
    fine = jax.vmap(episodes.can_begin)(both)
    first = jax.tree.map(lambda x: x[jnp.argmax(fine)], both)
    both = jax.vmap(reset_where, in_axes=(0, None, 0))(~fine, first, both)
    # A task's own weak types would become strong in the first step, which then compiles twice.
    both = jax.tree.map(strong, both)
    running = jax.tree.map(lambda x: x[:num_envs], both)
    starts = jax.tree.map(lambda x: x[num_envs:], both)
    return VectorState(running, starts, jnp.zeros((), jnp.int32))


def strong(x: Array) -> Array:
    """The array without a weak type."""
    return x.astype(x.dtype) if getattr(x, "weak_type", False) else x  # keys have no such thing


def scatter(envs: VectorState, key: PRNGKeyArray, episode_length: int) -> VectorState:
    """The same environments with their clocks set to random times of an episode.

    Were all episodes to begin together, every batch would hold one phase of the task only.
    """
    # `randint` would take three draws.
    share = jax.random.uniform(key, envs.running.time.shape)
    time = jnp.minimum((share * episode_length).astype(jnp.int32), episode_length - 1)
    return envs._replace(running=envs.running._replace(time=time))


def renewals(num_envs: int, unroll_length: int, episode_length: int) -> int:
    """Number of starts to sample for each unroll: at least as many as time limits will use.

    The number divides `num_envs`, so that parts of the pool never overlap; all blocks of it get the
    same.
    """
    parts = blocks.count(num_envs)
    size = num_envs // parts
    needed = min(size, math.ceil(size * unroll_length / episode_length))
    return parts * next(n for n in range(needed, size + 1) if size % n == 0)


def renew(
    episodes: Episodes,
    envs: VectorState,
    keys: Key[Array, "R"],
    mix: Callable[[EpisodeState], EpisodeState] = lambda fresh: fresh,
) -> VectorState:
    """The environments with the pool's oldest starts sampled anew, one with each of the keys (R,).

    Each block of the pool gets its share of them. R is what `renewals` says, or another number that
    the blocks can share and that divides the pool. `mix` may replace some of them. Where the policy
    would see a new one as NaN or infinite, the old one stays.
    """
    num_envs = len(envs.running.time)
    parts = blocks.count(num_envs)
    fresh = mix(jax.vmap(episodes.begin)(keys))
    fine = blocks.split(jax.vmap(episodes.can_begin)(fresh), parts)
    place = (envs.drawn * (len(keys) // parts)) % (num_envs // parts)

    def put(pool, new):
        old = jax.lax.dynamic_slice_in_dim(pool, place, new.shape[1], 1)
        kept = jax.vmap(jax.vmap(jnp.where))(fine, new, old)
        return jax.lax.dynamic_update_slice_in_dim(pool, kept, place, 1)

    starts = jax.tree.map(put, blocks.split(envs.starts, parts), blocks.split(fresh, parts))
    return envs._replace(starts=blocks.join(starts), drawn=envs.drawn + 1)


def unroll(
    episodes: Episodes,
    reward_params: Any,
    envs: VectorState,
    act: Act,
    keys: Key[Array, "T"],
    *,
    tau: Float[Array, ""] | float,
) -> tuple[VectorState, Rollout]:
    """Runs a control step of every environment with each of the keys (T,).

    Where an episode ends, a start of the pool follows. Should two end in one unroll, the same start
    follows twice. From unroll to unroll each block of the pool is turned by one place, so that an
    environment whose episodes end early meets other starts.
    """
    starts = _turned(envs)

    def one(episode, action):
        return episodes.advance(reward_params, episode, action, tau=tau)

    def move(running, key_step):
        observation = jax.vmap(episodes.observe)(running)
        action, extras = act(observation, key_step)
        running, result = jax.vmap(one)(running, action)
        last = jax.vmap(episodes.observe)(running)
        ended = result.terminated + result.truncated > 0
        running = jax.vmap(reset_where)(ended, starts, running)
        return running, Rollout(observation, action, extras, result, last, ended)

    running, steps = jax.lax.scan(move, envs.running, keys)
    return envs._replace(running=running), steps


def _turned(envs: VectorState) -> EpisodeState:
    """The start that waits for each, (B, ...): in its block, so many places on as `drawn`."""
    num_envs = len(envs.running.time)
    parts = blocks.count(num_envs)
    size = num_envs // parts
    turned = (jnp.arange(size) + envs.drawn) % size
    pool = blocks.split(envs.starts, parts)
    return blocks.join(jax.tree.map(lambda x: x[:, turned], pool))


def summary(steps: Rollout) -> dict[str, Float[Array, ""]]:
    """Means over the unroll; the task's own metrics over the episodes that ended in it.

    Only episodes from the task's own starts count for these; `episodes` is how many.
    """
    result = steps.result
    own = steps.ended * (1.0 - result.metrics.get("varied", jnp.zeros_like(result.reward)))
    episodes = jnp.sum(own)
    metrics = {
        name: jnp.sum(own * value) / jnp.maximum(episodes, 1.0)
        for name, value in result.metrics.items()
        if name != "varied"
    }
    return metrics | {
        "episodes": episodes,
        "reward": jnp.mean(result.reward),
        "nonfinite": jnp.sum(result.nonfinite),
    }
