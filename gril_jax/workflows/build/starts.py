"""Starts that a policy is evaluated from: sampled for each variant, and counted."""

import dataclasses
import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int, PRNGKeyArray

from gril_jax.config import EnvConfig
from gril_jax.envs import registry
from gril_jax.rl.episodes import Episodes, EpisodeState
from gril_jax.rl.evaluate import begin

from . import setup

_ROUNDING = 1e-6  # of the largest number of its kind: what two roundings of one start differ by


class Group(NamedTuple):
    """Episodes from the starts of one variant."""

    variant: str  # "" where the task has none
    begun: EpisodeState  # leaves (E, ...)
    start: Int[np.ndarray, "E"]  # which one each episode has, from 0

    @property
    def count(self) -> int:
        """Number of distinct starts."""
        return int(self.start.max()) + 1

    def share(self, success: Any) -> float:
        """The share of successes, (E or more,), in which each distinct start counts once."""
        own = np.asarray(success)[: len(self.start)]
        each = np.bincount(self.start, own) / np.bincount(self.start)
        return float(each.mean())


def draw(
    config: EnvConfig, variant: str | None, episodes: Episodes, key: PRNGKeyArray, *, count: int
) -> Group:
    """So many episodes of a variant, begun by the task's own resets. The key is consumed."""
    begun = begin(_among(config, variant, episodes), key, episodes=count)
    return Group(variant or "", begun, which(begun.state))


@functools.lru_cache(maxsize=16)  # `begin` is compiled once for each
def _among(config: EnvConfig, variant: str | None, episodes: Episodes) -> Episodes:
    """The episodes in a variant of their task."""
    env = setup.make_env(config, training=False, variant=variant)
    return dataclasses.replace(episodes, env=env)


def evaluated_from(config: EnvConfig) -> registry.Starts:
    """The variants that a configuration's policies are evaluated from."""
    return registry.starts(config.name, config.variant)


@functools.cache
def distinct(config: EnvConfig, variant: str | None, count: int) -> int:
    """The number of distinct starts among so many of a variant, by sampling as many."""
    env = setup.make_env(config, training=False, variant=variant)
    states = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), count))
    return int(which(states).max()) + 1


@jax.jit
def with_first(begun: EpisodeState, other: EpisodeState) -> EpisodeState:
    """The episodes with the first of some others behind them, (E + 1, ...)."""
    return jax.tree.map(lambda x, y: jnp.concatenate([x, y[:1]]), begun, other)


def which(states: Any) -> Int[np.ndarray, "E"]:
    """The index of each state's start among the distinct ones; states after a reset, (E, ...).

    Equal are those in which all numbers are, but for roundings; keys are not looked at.
    """
    leaves = [x for x in jax.tree.leaves(states) if x.size and not _is_key(x)]
    columns = [np.asarray(x).reshape(len(x), -1) for x in leaves]
    ranks = np.concatenate([_ranks(x.astype(np.float64)) for x in columns], axis=1)
    return np.unique(ranks, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int32)


def _is_key(leaf: Any) -> bool:
    if jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key):
        return True
    return leaf.dtype == np.uint32 and leaf.shape[-1:] in ((2,), (4,))  # a key of the older kind


def _ranks(values: Float[np.ndarray, "E D"]) -> Int[np.ndarray, "E D"]:
    """The rank of each number in its column, the same for numbers that differ by rounding alone."""
    order = np.argsort(values, axis=0)
    ordered = np.take_along_axis(values, order, axis=0)
    least = _ROUNDING * np.abs(values).max(initial=1e-30)
    steps = np.diff(ordered, axis=0, prepend=ordered[:1]) > least
    ranks = np.empty(values.shape, np.int32)
    np.put_along_axis(ranks, order, np.cumsum(steps, axis=0, dtype=np.int32), axis=0)
    return ranks
