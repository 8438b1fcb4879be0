"""Training starts at moments of the policy's own episodes: level B of help.

A share of the new starts is replaced by what running episodes have come to. Of a few of them the
one with the largest reward is taken, so that training goes on where the policy has come furthest by
what it is paid for; no state is read that the policy did not reach itself.

The share falls linearly to 0, which it has reached when a tenth of training is left: in the end the
policy learns from the task's own starts alone.

Shapes use B for environments and R for new starts.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from . import blocks
from .episodes import Episodes, EpisodeState, reset_where

_CANDIDATES = 4  # episodes among which the one with the largest reward is taken
_UNTIL = 0.9  # of training


def share_left(share: float, progress: Float[Array, ""] | float) -> Float[Array, ""]:
    """The share of own starts at a moment of training, `progress` from 0 to 1."""
    return share * jnp.clip(1.0 - jnp.asarray(progress) / _UNTIL, 0.0, 1.0)


def mixed(
    episodes: Episodes,
    reward_params: Any,
    running: EpisodeState,
    fresh: EpisodeState,
    key: PRNGKeyArray,
    *,
    share: Float[Array, ""] | float,
) -> EpisodeState:
    """The fresh starts (R, ...), each with probability `share` replaced by a moment of one of the
    running episodes (B, ...).

    The moment keeps its memories, and its clock begins at 0. Both are taken within the blocks of
    environments that never mix. The key is consumed.
    """
    worth = jax.vmap(lambda one: _worth(episodes, reward_params, one))(running)
    parts = blocks.count(len(worth))
    lanes = len(worth) // parts
    keys = jax.random.split(key, 2)
    shape = (parts, len(fresh.time) // parts)
    some = jax.random.randint(keys[0], (*shape, _CANDIDATES), 0, lanes)
    wanted = jax.random.uniform(keys[1], shape) < share
    pairs = blocks.split((running, worth), parts), blocks.split(fresh, parts)
    return blocks.join(jax.vmap(_replaced)(*pairs[0], pairs[1], some, wanted))


def _replaced(
    running: EpisodeState,
    worth: Float[Array, "L"],
    fresh: EpisodeState,
    some: Int[Array, "S C"],
    wanted: Bool[Array, "S"],
) -> EpisodeState:
    """The fresh starts of one block of L environments, S of them with C candidates each."""
    best = jnp.take_along_axis(some, jnp.argmax(worth[some], axis=1)[:, None], axis=1)[:, 0]
    own = jax.tree.map(lambda x: x[best], running)
    own = own._replace(time=jnp.zeros_like(own.time), own=jnp.ones_like(own.own))
    return jax.vmap(reset_where)(wanted, own, fresh)


def _worth(episodes: Episodes, reward_params: Any, episode: EpisodeState) -> Float[Array, ""]:
    """The reward of the moment that an episode has come to; least where it is not finite."""
    memory, active = episode.reward_memory, episode.memory.active
    reward = episodes.reward.step(reward_params, memory, episode.state, active)[1]
    return jnp.where(jnp.isfinite(reward), reward, -jnp.inf)
