"""Finds stage ends in the reward trace of a whole task, and the stage of each frame.

A learned reward climbs a staircase along a demonstration: it rises while an object is brought
to its place, and is flat while the empty hand travels. The end of a rise marks a stage as
finished. `transitions` follows the trace and finds such ends. T is the number of frames;
everything can be jitted. Traces of unequal length are padded with their last value, which makes no
boundary. Boundaries of several demonstrations are compared in `gril_jax.subtasks.matching`.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from gril_jax.errors import ConfigError


def transitions(
    reward: Float[Array, "T"],
    *,
    prominence: Float[Array, ""] | float = 0.1,
    smoothing: int = 5,
    patience: Int[Array, ""] | int = 8,
) -> Bool[Array, "T"]:
    """Frames at which a rise of the reward ends.

    First a running median: unlike a mean, it keeps a step where it is. A rise is over once
    nothing has topped it by a quarter of `prominence` for `patience` frames; it counts if it
    was at least `prominence` high. Its end is the frame from which the trace stays within an
    eighth of `prominence` of that top. Dips on the way up neither end a rise nor begin one,
    unless they last.

    Args:
      reward: one trace, in order of time.
      prominence: the least height of a rise, in units of the reward (a learned reward goes from
        about -1 to 0).
      smoothing: width of the running median in frames, odd; 1 leaves the trace alone.
      patience: how many frames without progress make a plateau. A rise that stands when the
        trace ends needs none.

    Returns:
      True at the boundaries. The last stage's end is one of them.

    Raises:
      ConfigError: the smoothing is not odd and positive.
    """
    trace = running_median(reward, smoothing)
    num_frames = trace.shape[0]

    def visit(carry, inputs):
        low, peak, peak_frame = carry
        frame, value = inputs
        restart = value < low
        better = restart | (value > peak + 0.25 * prominence)
        low = jnp.where(restart, value, low)
        peak = jnp.where(better, value, peak)
        peak_frame = jnp.where(better, frame, peak_frame)

        plateau = (frame - peak_frame >= patience) | (frame == num_frames - 1)
        ended = plateau & (peak - low >= prominence)
        top = jnp.where(ended, peak_frame, num_frames)  # out of range: no rise ended here
        low = jnp.where(ended, peak, low)
        return (low, peak, peak_frame), top

    start = (trace[0], trace[0], jnp.zeros((), jnp.int32))
    frames = jnp.arange(num_frames, dtype=jnp.int32)
    _, tops = jax.lax.scan(visit, start, (frames, trace))

    # Noise on a plateau puts its top too late: go back to the last frame clearly below it.
    below = (frames < frames[:, None]) & (trace < trace[:, None] - 0.125 * prominence)
    arrival = jnp.max(jnp.where(below, frames + 1, 0), axis=1)
    boundaries = jnp.where(tops < num_frames, arrival[tops], num_frames)
    return jnp.zeros(num_frames, bool).at[boundaries].set(True, mode="drop")


def segments(boundary: Bool[Array, "T"]) -> Int[Array, "T"]:
    """The stage of each frame, counted from 0; a boundary frame is its stage's last.

    >>> segments(jnp.array([False, True, False, False])).tolist()
    [0, 0, 1, 1]
    """
    counts = boundary.astype(jnp.int32)
    return jnp.cumsum(counts) - counts


def running_median(x: Float[Array, "T"], width: int) -> Float[Array, "T"]:
    """Centred median with the ends held: unlike a mean, it keeps a step where it is.

    Raises:
      ConfigError: the width is not positive.
    """
    if width < 1:
        raise ConfigError(f"smoothing is {width}; it must be at least 1 frame.")
    before = (width - 1) // 2
    padded = jnp.pad(x, (before, width - 1 - before), mode="edge")
    windows = jnp.stack([padded[i : i + x.shape[0]] for i in range(width)])
    return jnp.median(windows, axis=0)
