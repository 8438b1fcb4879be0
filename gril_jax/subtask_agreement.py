"""Ends of stages on which demonstrations agree, from their reward traces together.

One trace by itself is a poor witness: a step may be as small as the noise, and a pause in the
middle of a rise as long as a short plateau. But demonstrations of one task climb the same stairs:
what is a stage's end in one has the same reward in the others. So

    patience = agreed_patience(rewards, length)           # how long a plateau must be
    stages = agreed_boundaries(rewards, length, patience=patience)

takes what `gril_jax.subtasks.transitions` finds in each trace, keeps what most have at the same
reward, and where a trace lacks it, marks the frame at which that reward is reached. No label is
used. Everything can be jitted. Shapes use B for demonstrations, T for frames, M for boundaries and
P for patiences.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .subtask_matching import boundary_frames, shared_boundaries
from .subtasks import running_median, transitions

__all__ = ["MOST", "AgreedBoundaries", "agreed_boundaries", "agreed_patience", "each_alone"]

MOST = 12  # boundaries of one demonstration, at most
# Patiences that are tried, in shares of the middle length of the videos.
_SHARES = (0.02, 0.03, 0.045, 0.065, 0.09, 0.12)


class AgreedBoundaries(NamedTuple):
    """The same stages in every demonstration; those kept come first, in order of time."""

    frames: Int[Array, "B M"]  # last frame of each stage, increasing; -1 in slots not kept
    kept: Bool[Array, "M"]
    support: Float[Array, "M"]  # share of the demonstrations that show it by themselves
    found: Bool[Array, "B M"]  # whether this one does
    level: Float[Array, "M"]  # reward at which the stage ends


def agreed_boundaries(
    reward: Float[Array, "B T"],
    length: Int[Array, "B"],
    *,
    prominence: Float[Array, ""] | float = 0.125,
    smoothing: int = 15,
    patience: Int[Array, ""] | int = 8,
    support: Float[Array, ""] | float = 0.5,
) -> AgreedBoundaries:
    """Boundaries that at least the share `support` of the demonstrations has at the same reward.

    Two boundaries are the same if their rewards differ by less than `prominence`.

    Args:
      reward: of every frame, padded in any way.
      length: frames before padding.
      prominence, smoothing, patience: of `transitions`.
      support: see above.

    Raises:
      ConfigError: a number is out of its range.
    """
    trace = jax.vmap(lambda x: running_median(x, smoothing))(_held(reward, length))
    own = each_alone(reward, length, prominence=prominence, smoothing=smoothing, patience=patience)
    shared = shared_boundaries(
        trace[:, :, None], own, length, tolerance=prominence, support=support
    )
    there = jnp.take_along_axis(trace, jnp.maximum(shared.frames, 0), axis=1)
    total = jnp.sum(jnp.where(shared.found, there, 0.0), axis=0)
    level = total / jnp.maximum(jnp.sum(shared.found, axis=0), 1)

    def reached(trace, frames, found):
        """Boundaries that lack are set to the first frame at the level after the one before."""

        def place(before, one):
            level, frame, found, kept = one
            at = jnp.arange(len(trace))
            there = (at > before) & (at < frame) & (trace >= level - 0.25 * prominence)
            frame = jnp.where(found | ~there.any(), frame, jnp.argmax(there))
            return jnp.where(kept, frame, before), jnp.where(kept, frame, -1)

        return jax.lax.scan(place, -1, (level, frames, found, shared.kept))[1]

    frames = jax.vmap(reached)(trace, shared.frames, shared.found)
    return AgreedBoundaries(
        frames, shared.kept, shared.support, shared.found, jnp.where(shared.kept, level, 0.0)
    )


def agreed_patience(
    reward: Float[Array, "B T"],
    length: Int[Array, "B"],
    *,
    prominence: Float[Array, ""] | float = 0.125,
    smoothing: int = 15,
    support: Float[Array, ""] | float = 0.5,
) -> Int[Array, ""]:
    """The patience with which each demonstration's stages are most like the common ones.

    Too short a patience cuts rises at their pauses, here in two and there in three; too long a one
    passes over plateaus, here and not there. Alike is Dice's coefficient of the boundaries found in
    each trace and the common ones; one common boundary, which any trace has, counts as none. Of
    equally good patiences the shortest.

    Args:
      reward, length, prominence, smoothing, support: as in `agreed_boundaries`.
    """
    shares = jnp.array(_SHARES)
    patiences = jnp.maximum(1, jnp.round(shares * jnp.median(length))).astype(jnp.int32)

    def agreement(patience):
        rule = {"prominence": prominence, "smoothing": smoothing, "patience": patience}
        own = jnp.sum(each_alone(reward, length, **rule) >= 0)
        common = agreed_boundaries(reward, length, **rule, support=support)
        kept = jnp.sum(common.kept)
        alike = 2 * jnp.sum(common.found) / jnp.maximum(own + kept * len(length), 1)
        return jnp.where(kept >= 2, alike, 0.0)

    return patiences[jnp.argmax(jax.lax.map(agreement, patiences))]


def each_alone(reward: Float[Array, "B T"], length: Int[Array, "B"], **rule) -> Int[Array, "B M"]:
    """Frames that `transitions` marks in each trace, filled up with -1; options are its own."""
    within = jnp.arange(reward.shape[1]) < length[:, None]
    marked = jax.vmap(lambda x: transitions(x, **rule))(_held(reward, length)) & within
    return jax.vmap(lambda x: boundary_frames(x, MOST))(marked)


def _held(reward, length):
    """A trace that goes on standing where it ends has the same boundaries, and none after it."""
    frames = jnp.minimum(jnp.arange(reward.shape[1]), length[:, None] - 1)
    return jnp.take_along_axis(reward, frames, axis=1)
