"""Resets of training episodes to states beside the task's own initial ones.

Visited states are states of running episodes. They are sampled evenly over the range of their
rewards, so that few of high reward count as much as many of low reward. Among equal ones, states
with unusual object positions are preferred, as in Go-Explore (Ecoffet et al. 2021). Such an episode
may in turn leave visited states, so that a search grows longer than an episode.

Video states are frames of the demonstrations. The task places its objects at the boxes by its
`place(center, size, key)`, and samples what boxes do not show.

Both fractions fall linearly to 0 over the first nine tenths of training. In the end the policy
learns from the task's own initial states alone.

Shapes use B for environments, R for new starts and F for frames; L and S are those of a block.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key, PRNGKeyArray

from . import blocks
from .episodes import Episodes, EpisodeState, reset_where
from .rewards import AnyReward, Reward, as_reward

_ALIKE = 0.05  # of the range of rewards: states whose rewards differ less are alike
_UNTIL = 0.9  # of training


class Frames(NamedTuple):
    """Frames of demonstrations, as boxes in the order of the task's objects."""

    center: Float[Array, "F N 2"]  # world units
    size: Float[Array, "F N 2"]
    active: Bool[Array, "F N"]  # what has moved in its video up to then
    held: Bool[Array, "F N"] | None = None
    """True for things that the hand holds, by the whole video; for a task with `place_held`."""


class WithFrames(NamedTuple):
    """Parameters of a reward, with the frames that training may reset to."""

    reward: Any
    frames: Frames


def with_frames(reward: AnyReward) -> Reward:
    """The same reward with `WithFrames` for its parameters."""
    own = as_reward(reward)
    return own._replace(step=lambda params, *rest: own.step(params.reward, *rest))


def share_left(share: float, progress: Float[Array, ""] | float) -> Float[Array, ""]:
    """The share of such starts when training has come to `progress`, from 0 to 1."""
    return share * jnp.clip(1.0 - jnp.asarray(progress) / _UNTIL, 0.0, 1.0)


def of_videos(
    episodes: Episodes,
    frames: Frames,
    fresh: EpisodeState,
    keys: Key[Array, "R"],
    *,
    share: Float[Array, ""] | float,
) -> EpisodeState:
    """The fresh starts (R, ...), each with probability `share` replaced by a frame of a video.

    The keys are consumed.
    """

    def placed(frame, key):
        boxes = frames.center[frame], frames.size[frame]
        if frames.held is None:
            return episodes.env.place(*boxes, key)
        return episodes.env.place_held(*boxes, key, frames.held[frame])

    def one(fresh, key):
        key_frame, key_wanted, key_place = jax.random.split(key, 3)
        frame = jax.random.randint(key_frame, (), 0, len(frames.center))
        start = episodes.started(placed(frame, key_place), frames.active[frame])
        wanted = jax.random.uniform(key_wanted) < share
        return reset_where(wanted, start._replace(varied=jnp.ones(())), fresh)

    return jax.vmap(one)(fresh, keys)


def of_own(
    episodes: Episodes,
    reward_params: Any,
    running: EpisodeState,
    fresh: EpisodeState,
    key: PRNGKeyArray,
    *,
    share: Float[Array, ""] | float,
) -> EpisodeState:
    """The fresh starts (R, ...), each with probability `share` replaced by a visited state.

    Visited states are those of the running episodes (B, ...). They keep their memories, and their
    clocks begin at 0. A start and its visited state belong to the same block of environments, since
    blocks never mix. The key is consumed.
    """
    worth = jax.vmap(lambda one: _worth(episodes, reward_params, one))(running)
    parts = blocks.count(len(worth))
    before = blocks.split((running, worth, fresh), parts)
    keys = jax.random.split(key, parts)
    return blocks.join(jax.vmap(lambda *of: _replaced(*of, share))(*before, keys))


def _replaced(
    running: EpisodeState,
    worth: Float[Array, "L"],
    fresh: EpisodeState,
    key: PRNGKeyArray,
    share: Float[Array, ""] | float,
) -> EpisodeState:
    """The fresh starts of one block of L environments."""
    keys, count = jax.random.split(key, 3), len(fresh.time)
    which = taken(
        keys[0], worth, running.state.objects.center, jax.random.uniform(keys[1], (count,))
    )
    own = jax.tree.map(lambda x: x[which], running)
    own = own._replace(time=jnp.zeros_like(own.time), varied=jnp.ones_like(own.varied))
    wanted = jax.random.uniform(keys[2], (count,)) < share
    return jax.vmap(reset_where)(wanted, own, fresh)


def taken(
    key: PRNGKeyArray,
    worth: Float[Array, "L"],
    center: Float[Array, "L N 2"],
    where: Float[Array, "S"],
) -> Int[Array, "S"]:
    """States whose rewards are about `where` of the way from the least reward to the largest.

    Among states of similar reward it samples in proportion to the summed distance of the objects
    from those of the most similar state. Rewards that are not finite are left out.
    """
    known = jnp.isfinite(worth)
    least = jnp.min(jnp.where(known, worth, jnp.inf))
    most = jnp.max(jnp.where(known, worth, -jnp.inf))
    off = jnp.abs(worth - (least + where * (most - least))[:, None])
    off = jnp.where(known, off, jnp.inf)
    alike = off <= jnp.maximum(off.min(axis=1, keepdims=True), _ALIKE * (most - least))
    apart = jnp.sqrt(jnp.sum((center[:, None] - center) ** 2, axis=-1)).sum(axis=-1)
    alone = jnp.min(jnp.where(jnp.eye(len(worth), dtype=bool), jnp.inf, apart), axis=1)
    odds = jnp.log(jnp.where(jnp.isfinite(alone), alone, 0.0) + 1e-6)
    return jax.random.categorical(key, jnp.where(alike, odds, -jnp.inf), axis=1)


def _worth(episodes: Episodes, reward_params: Any, episode: EpisodeState) -> Float[Array, ""]:
    """The reward of an episode's present state."""
    memory, active = episode.reward_memory, episode.memory.active
    return episodes.reward.step(reward_params, memory, episode.state, active)[1]
