"""Activity bits: the objects that have moved since the episode began (Eq. 4 of the paper).

Object i becomes active at frame t if its centre lies more than tau box diagonals from where it
was k frames earlier, and stays active for the rest of the episode. Frames before the first
count as the first. The paper uses k = 40 and tau = 0.005.

`init` and `step` follow a rollout frame by frame; `trajectory` does a whole recording at once.
Both give the same bits, with every option. A displacement from or to a box that is not finite, such
as one that a detector lost, is no motion. Shapes use N for objects, T for frames, K for the
window and M for the frames of a median. Goal and robot get a bit like anything else: the encoder
weighs it (`gril_jax.encoders.message_passing`).

Boxes from a detector. tau is a third of a pixel for a box of 50 pixels: the slightest jitter sets
every bit for good. `smoothing` and `noise` prevent that. The first column is the chance that a box
at rest becomes active within 120 frames, if its centre jitters by 0.35 pixels an axis. The second
is the same if one frame in 500 is 8 pixels off as well. The others are the frames until a push of
0.5, 1 or 3 pixels a frame is seen (medians of 4,000 trials):

    the paper's rule             100 %     100 %    -
    tau=0.03                       1.1 %    22 %    4  3  1
    noise=0.35, smoothing=3        0.04 %    0.1 %  5  3  2
    noise=0.35, smoothing=5        0.06 %    0.1 %  5  4  3
    means of 5 instead of medians  0.04 %   19 %    5  3  2
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from gril_jax.config.encoder import PoolConfig
from gril_jax.errors import ConfigError, ShapeError
from gril_jax.types import checked

# Standard deviations of a resting centre's displacement that count as motion. For Gaussian noise
# exp(-z^2 / 2) of the frames exceed z of them: 4 in a million.
_DEVIATIONS = 5.0


class Start(NamedTuple):
    """State of smoothing: frames to smooth over, and the time in the episode."""

    recent: Float[Array, "M-1 N 2"]  # centres as seen, oldest first
    origin: Float[Array, "N 2"]  # smoothed centre that stands for all earlier ones
    frame: Int[Array, ""]  # of the frame seen last; 0 is the episode's first


class Memory(NamedTuple):
    """Activity state of an episode, to be reset when an episode begins."""

    past: Float[Array, "K N 2"]  # centres of the last K frames, as a ring
    oldest: Int[Array, ""]  # the ring's slot that holds frame t - K
    active: Bool[Array, "N"]  # bits of the frame seen last
    start: Start | None = None


@checked
def init(
    center: Float[Array, "N 2"],
    *,
    window: int = PoolConfig.window,
    smoothing: int = PoolConfig.smoothing,
) -> Memory:
    """State after an episode's first frame: nothing has moved.

    Args:
      center: box centres of the first frame, world units.
      window: k, how many frames back a centre is compared with; at least 1.
      smoothing: M, odd: each centre is first replaced by its median, axis by axis, over the
        last M frames. The first M frames find where an object is, and set no bit.

    Raises:
      ConfigError: `window` is below 1, or `smoothing` not odd and positive.
    """
    _check_frames(window, smoothing)
    start = None
    if smoothing > 1:
        recent = jnp.broadcast_to(center, (smoothing - 1, *center.shape))
        start = Start(recent, center, jnp.zeros((), jnp.int32))
    return Memory(
        past=jnp.broadcast_to(center, (window, *center.shape)),
        oldest=jnp.zeros((), jnp.int32),
        active=jnp.zeros(center.shape[0], bool),
        start=start,
    )


@checked
def step(
    memory: Memory,
    center: Float[Array, "N 2"],
    size: Float[Array, "N 2"],
    *,
    tau: Float[Array, ""] | float = PoolConfig.tau,
    noise: Float[Array, ""] | float | None = None,
) -> tuple[Memory, Bool[Array, "N"]]:
    """The next frame's activity bits.

    Args:
      memory: from `init` or the previous `step`.
      center: box centres of this frame, world units.
      size: box widths and heights of this frame, world units.
      tau: displacement that counts as motion, in diagonals of the object's own box.
      noise: standard deviation of a centre's jitter along one axis, world units. A displacement
        must then also exceed five times the deviation that such jitter gives it; smoothing by
        medians makes that smaller.

    Returns:
      The memory for the next frame and this frame's bits.

    Raises:
      ShapeError: `center`, `size` and the memory are not of the same objects.
      ConfigError: `tau` or `noise` is known and negative.
    """
    _check_boxes(center, size, (*memory.active.shape, 2))
    check_not_negative(tau=tau, noise=noise)
    start, before = memory.start, memory.past[memory.oldest]
    if start is None:
        moved = _moved(before, center, size, tau, noise, smoothing=1)
    else:
        smoothing = start.recent.shape[0] + 1
        first = memory.past.shape[0] + smoothing - 1  # with a full median k frames earlier
        seen = jnp.concatenate([start.recent, center[None]])
        frame, center = start.frame + 1, _median([*seen])
        origin = jnp.where(frame < smoothing, center, start.origin)
        before = jnp.where(frame < first, origin, before)
        start = Start(seen[1:], origin, frame)
        moved = _moved(before, center, size, tau, noise, smoothing)
    active = memory.active | moved
    memory = Memory(
        past=memory.past.at[memory.oldest].set(center),
        oldest=(memory.oldest + 1) % memory.past.shape[0],
        active=active,
        start=start,
    )
    return memory, active


@checked
def trajectory(
    center: Float[Array, "T N 2"],
    size: Float[Array, "T N 2"],
    *,
    tau: Float[Array, ""] | float = PoolConfig.tau,
    window: int = PoolConfig.window,
    smoothing: int = PoolConfig.smoothing,
    noise: Float[Array, ""] | float | None = None,
) -> Bool[Array, "T N"]:
    """The activity bits of every frame of one recording; all False in the first.

    Arguments and errors are those of `init` and `step`.

    >>> center = jnp.array([[[0.0, 0.0], [1.0, 0.0]], [[0.0, 0.0], [1.2, 0.0]]])  # the second moves
    >>> trajectory(center, jnp.ones((2, 2, 2)), tau=0.1).tolist()
    [[False, False], [False, True]]
    """
    _check_boxes(center, size, (*center.shape[:-1], 2))
    _check_frames(window, smoothing)
    check_not_negative(tau=tau, noise=noise)
    frames = jnp.arange(center.shape[0])
    if smoothing > 1:
        back = range(smoothing - 1, -1, -1)
        center = _median([center[jnp.maximum(frames - b, 0)] for b in back])
    # Before frame M - 1 a median holds the first frame more than once: that one stands for them.
    earlier = jnp.maximum(frames - window, smoothing - 1)
    if smoothing > 1:
        earlier = jnp.minimum(earlier, frames)
    moved = _moved(center[earlier], center, size, tau, noise, smoothing)
    return jax.lax.cummax(moved.astype(jnp.int32), axis=0).astype(bool)


def _moved(
    before: Float[Array, "*frames N 2"],
    center: Float[Array, "*frames N 2"],
    size: Float[Array, "*frames N 2"],
    tau: Float[Array, ""] | float,
    noise: Float[Array, ""] | float | None,
    smoothing: int,
) -> Bool[Array, "*frames N"]:
    # Squares on both sides: no square root to round, and the two forms agree to the bit.
    displacement = jnp.sum(jnp.square(center - before), axis=-1)
    threshold = tau**2 * jnp.sum(jnp.square(size), axis=-1)
    if noise is not None:
        # A difference of two medians. The variance of a Gaussian median of M approaches
        # pi / (2 M); this form is 1 for M = 1, and within 2 % of the truth for all M.
        variance = 2.0 * (math.pi / 2) / (smoothing + math.pi / 2 - 1)
        threshold = jnp.maximum(threshold, noise**2 * (_DEVIATIONS**2 * variance))
    # From or to a box that is not finite nothing has moved.
    return (displacement > threshold) & (displacement < jnp.inf)


def _median(values: list[Float[Array, "*frames N 2"]]) -> Float[Array, "*frames N 2"]:
    """Median of an odd number of arrays, by exchanging neighbours in their list.

    Minima and maxima fuse into the loop around them, where a sort would be a program of its own;
    and a median rounds nothing, so that both forms agree to the bit.
    """
    for last in range(len(values) - 1, len(values) // 2 - 1, -1):
        for i in range(last):
            low = jnp.minimum(values[i], values[i + 1])
            values[i], values[i + 1] = low, jnp.maximum(values[i], values[i + 1])
    return values[len(values) // 2]


def _check_frames(window, smoothing):
    if window < 1:
        raise ConfigError(f"window is {window}; it must be at least 1 frame.")
    if smoothing < 1 or smoothing % 2 == 0:
        raise ConfigError(f"smoothing is {smoothing}; it must be an odd number of frames.")


def check_not_negative(**values: Float[Array, ""] | float | None) -> None:
    """Raises ConfigError if one of the values is known at trace time and negative."""
    for name, value in values.items():
        known = value is not None and not isinstance(value, jax.core.Tracer)
        if known and not float(value) >= 0:
            raise ConfigError(f"{name} is {value}; it must not be negative.")


def _check_boxes(center, size, shape):
    if center.shape != shape or size.shape != shape:
        shapes = f"center has shape {center.shape} and size has shape {size.shape}"
        raise ShapeError(f"{shapes}; both must be {shape}.")
