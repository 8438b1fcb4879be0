"""Training starts beside the task's own: moments of the policy's own episodes, and of videos.

Own moments (level B of help) are what running episodes have come to. Of a few of them the one with
the largest reward is taken, so that training goes on where the policy has come furthest by what it
is paid for; no state is read that the policy did not reach itself.

Moments of videos (level V) are frames of the demonstrations: the task places its objects where the
boxes lie, by its `place(center, size, key)`, and draws what boxes do not show.

Both shares fall linearly to 0, which they have reached when a tenth of training is left: in the end
the policy learns from the task's own starts alone.

Shapes use B for environments, R for new starts and F for frames.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key, PRNGKeyArray

from . import blocks
from .episodes import Episodes, EpisodeState, reset_where
from .rewards import AnyReward, Reward, as_reward

_CANDIDATES = 4  # episodes among which the one with the largest reward is taken
_UNTIL = 0.9  # of training


class Frames(NamedTuple):
    """Frames of demonstrations, as boxes in the order of the task's objects."""

    center: Float[Array, "F N 2"]  # world units
    size: Float[Array, "F N 2"]
    active: Bool[Array, "F N"]  # what has moved in its video up to then


class WithFrames(NamedTuple):
    """Parameters of a reward, with the frames that training may begin at."""

    reward: Any
    frames: Frames


def with_frames(reward: AnyReward) -> Reward:
    """The same reward with `WithFrames` for its parameters."""
    own = as_reward(reward)
    return own._replace(step=lambda params, *rest: own.step(params.reward, *rest))


def share_left(share: float, progress: Float[Array, ""] | float) -> Float[Array, ""]:
    """The share of such starts at a moment of training, `progress` from 0 to 1."""
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

    def one(fresh, key):
        key_frame, key_wanted, key_place = jax.random.split(key, 3)
        frame = jax.random.randint(key_frame, (), 0, len(frames.center))
        center, size, active = (x[frame] for x in frames)
        start = episodes.started(episodes.env.place(center, size, key_place), active)
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
    before = blocks.split((running, worth, fresh), parts)
    return blocks.join(jax.vmap(_replaced)(*before, some, wanted))


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
    own = own._replace(time=jnp.zeros_like(own.time), varied=jnp.ones_like(own.varied))
    return jax.vmap(reset_where)(wanted, own, fresh)


def _worth(episodes: Episodes, reward_params: Any, episode: EpisodeState) -> Float[Array, ""]:
    """The reward of the moment that an episode has come to; least where it is not finite."""
    memory, active = episode.reward_memory, episode.memory.active
    reward = episodes.reward.step(reward_params, memory, episode.state, active)[1]
    return jnp.where(jnp.isfinite(reward), reward, -jnp.inf)
