"""Reward trace of a whole task -> where its stages end -> which stage each frame is in.

A learned reward climbs a staircase along a demonstration: it rises while an object is brought
to its place, and is flat while the empty hand travels. The end of a rise marks a stage as
finished. Two detectors find such ends: `transitions` follows the trace, `gradient_peaks` looks
for bursts in its slope. T is the number of frames; everything can be jitted. Traces of unequal
length are padded with their last value, which makes no boundary. Boundaries of several
demonstrations are compared in `gril_jax.subtasks.matching`.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from gril_jax.errors import ConfigError

__all__ = [
    "gaussian_smooth",
    "gradient_peaks",
    "peak_prominences",
    "running_median",
    "segments",
    "transitions",
]


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


def gradient_peaks(
    reward: Float[Array, "T"],
    *,
    prominence: Float[Array, ""] | float = 0.01,
    smoothing: int = 5,
    sigma: Float[Array, ""] | float = 2.0,
    ends: bool = True,
) -> Bool[Array, "T"]:
    """Frames at which the slope of the reward bursts, or at which such a burst ends.

    The trace is smoothed by a running median and a Gaussian; peaks of its slope (central
    differences) count if their prominence is large enough. Next to `transitions` it needs no
    plateau after a rise, and is more easily misled by noise.

    Args:
      reward: one trace, in order of time.
      prominence: least prominence of a peak, in reward units per frame.
      smoothing: width of the running median in frames, odd; 1 leaves the trace alone.
      sigma: standard deviation of the Gaussian in frames; 0 leaves the trace alone.
      ends: mark where each burst is over, which is the stage's end: the first frame after the
        peak whose slope is below a tenth of the peak's, or the next peak's foot. If not, mark
        the peaks themselves.

    Returns:
      True at the marks.

    Raises:
      ConfigError: the smoothing is not odd and positive.
    """
    trace = gaussian_smooth(running_median(reward, smoothing), sigma)
    num_frames = trace.shape[0]
    if num_frames < 3:
        return jnp.zeros(num_frames, bool)
    slope = jnp.gradient(trace)
    # Flat beyond both ends, so that a burst that the video's end cuts off is a peak, too.
    padded = jnp.pad(slope, 1)
    peaks = peak_prominences(padded)[1:-1] >= jnp.maximum(prominence, jnp.finfo(slope.dtype).tiny)
    if not ends:
        return peaks
    frames = jnp.arange(num_frames)
    later = frames > frames[:, None]
    next_peak = jnp.min(jnp.where(later & peaks, frames, num_frames), axis=1)
    between = later & (frames < next_peak[:, None])
    over = between & (slope <= 0.1 * slope[:, None])
    first_over = jnp.min(jnp.where(over, frames, num_frames), axis=1)
    foot = jnp.argmin(jnp.where(between, slope, jnp.inf), axis=1)
    end = jnp.where(first_over < num_frames, first_over, foot)
    end = jnp.where(peaks, jnp.where(jnp.any(between, axis=1), end, frames), num_frames)
    return jnp.zeros(num_frames, bool).at[end].set(True, mode="drop")


def peak_prominences(x: Float[Array, "T"]) -> Float[Array, "T"]:
    """How far each peak stands above its surroundings; 0 at frames that are no peak.

    As `scipy.signal.find_peaks` and `peak_prominences`: a peak is higher than what is on both
    its sides (of a flat top, the middle frame); the first and the last frame are none. From it
    one goes down to the lowest point on either side before something higher comes, or the end;
    the prominence is the height above the higher of the two. Memory grows with T^2.

    >>> peak_prominences(jnp.array([0.0, 2.0, 1.0, 3.0, 0.0])).tolist()
    [0.0, 1.0, 0.0, 3.0, 0.0]
    """
    num_frames = x.shape[0]
    frames = jnp.arange(num_frames)
    before, after = frames < frames[:, None], frames > frames[:, None]
    differs, higher = x != x[:, None], x > x[:, None]

    def last(mask):  # the last frame before each at which the mask holds; -1 if none
        return jnp.max(jnp.where(before & mask, frames, -1), axis=1, initial=-1)

    def first(mask):
        return jnp.min(jnp.where(after & mask, frames, num_frames), axis=1, initial=num_frames)

    left, right = last(differs), first(differs)  # of the flat stretch that each frame is in
    inside = (left >= 0) & (right < num_frames) & (frames == (left + right) // 2)
    lower = (x[jnp.maximum(left, 0)] < x) & (x[jnp.minimum(right, num_frames - 1)] < x)
    left, right = last(higher)[:, None], first(higher)[:, None]
    left_base = jnp.min(jnp.where((frames > left) & ~after, x, jnp.inf), axis=1)
    right_base = jnp.min(jnp.where((frames < right) & ~before, x, jnp.inf), axis=1)
    return jnp.where(inside & lower, x - jnp.maximum(left_base, right_base), 0.0)


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


def gaussian_smooth(x: Float[Array, "T"], sigma: Float[Array, ""] | float) -> Float[Array, "T"]:
    """Gaussian mean with the ends held. `sigma` is in frames; 0 changes nothing.

    The trace is held for T frames on both sides, where the weights have vanished for any sigma
    below T / 4. Memory grows with T^2.
    """
    num_frames = x.shape[0]
    source = jnp.arange(-num_frames, 2 * num_frames)
    offset = source - jnp.arange(num_frames)[:, None]
    sigma = jnp.asarray(sigma, jnp.result_type(x.dtype, jnp.float32))
    exponent = -0.5 * jnp.square(offset / jnp.where(sigma > 0, sigma, 1.0))
    weights = jnp.where(sigma > 0, jax.nn.softmax(exponent, axis=1), offset == 0)
    held = x[jnp.clip(source, 0, num_frames - 1)]
    return jnp.matmul(weights, held, precision="highest").astype(x.dtype)
