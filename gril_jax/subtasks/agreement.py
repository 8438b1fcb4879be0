"""Stage ends on which demonstrations agree, from all their reward traces together.

One trace by itself does not suffice: a step may be as small as the noise, and a pause in the
middle of a rise as long as a short plateau. But in demonstrations of one task the reward rises in
the same steps. A stage ends at the same reward in all of them; or, if some have further to go than
others, after the same share of the way from the trace's begin to its end. So

    stages = agreed_boundaries(rewards, length, patience=8)
    patience, stages = agreed_stages(rewards, length)     # where it is not known

takes the ends that `gril_jax.subtasks.transitions` finds in each trace. It keeps those that most
traces have at the same reward or share, whichever they agree on better. Where a trace lacks one, it
marks the frame at which that reward or share is reached. A trace that shows as many ends by itself
as are agreed on keeps its own if none is at twice as different a reward. Patience is how long a
plateau must be. No label is used. Everything can be jitted. Shapes use B for demonstrations, T for
frames, M for boundaries and P for patiences.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from gril_jax.errors import ConfigError
from gril_jax.types import checked

from .matching import SharedBoundaries, boundary_frames, shared_boundaries

MOST = 12  # boundaries of one demonstration, at most
# Patiences that are tried, in shares of the middle length of the videos. An even rise through a
# whole video may stand still for the first, but not for the others: it has no plateau.
_FEWEST = 2  # frames
_SHARES = (0.045, 0.065, 0.09, 0.12)


@checked
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


@checked
def running_median(x: Float[Array, "T"], width: int) -> Float[Array, "T"]:
    """Centred median with the ends held: unlike a mean, it keeps a step where it is.

    Raises:
      ConfigError: the width is not odd and positive.
    """
    if width < 1 or width % 2 == 0:
        raise ConfigError(f"smoothing is {width}; it must be an odd number of frames.")
    padded = jnp.pad(x, width // 2, mode="edge")
    windows = jnp.stack([padded[i : i + x.shape[0]] for i in range(width)])
    return jnp.median(windows, axis=0)


@checked
def agreed_boundaries(
    reward: Float[Array, "B T"],
    length: Int[Array, "B"],
    *,
    prominence: Float[Array, ""] | float = 0.125,
    smoothing: int = 15,
    patience: Int[Array, ""] | int = 8,
    support: Float[Array, ""] | float = 0.5,
) -> SharedBoundaries:
    """Boundaries shared by at least the share `support` of the demonstrations.

    Two boundaries are the same if their rewards, or their shares of the way from a trace's first
    reward to its last one, differ by less than `prominence`; of the two scales that counts on which
    the demonstrations are more alike, as `agreed_stages` has it.

    Args:
      reward: of every frame, padded in any way.
      length: frames before padding.
      prominence, smoothing, patience: of `transitions`.
      support: see above.

    Raises:
      ConfigError: `smoothing` is not odd and positive, or `support` is known and not in (0, 1].
    """
    if not isinstance(support, jax.core.Tracer) and not 0 < float(support) <= 1:
        raise ConfigError(f"support is {support}; it must be above 0 and at most 1.")
    trace = _smoothed(reward, length, smoothing)
    own = each_alone(reward, length, prominence=prominence, smoothing=smoothing, patience=patience)
    return _settled(trace, own, _common(trace, own, length, prominence, support), prominence)


def _smoothed(reward, length, smoothing):
    return jax.vmap(lambda x: running_median(x, smoothing))(_held(reward, length))


def _common(trace, own, length, prominence, support) -> SharedBoundaries:
    """The common boundaries, on the scale on which traces agree more."""
    scales = jnp.stack([trace, _way(trace, length, prominence)])
    both = jax.vmap(lambda scale: _shared(scale, own, length, prominence, support))(scales)
    better = jnp.argmax(jax.vmap(_alike, in_axes=(None, 0))(own, both))
    return jax.tree.map(lambda x: x[better], both)


def _settled(trace, own: Int[Array, "B M"], shared: SharedBoundaries, near) -> SharedBoundaries:
    """The boundaries, those of traces that have as many by themselves as found there, unless one
    is further than twice `near` from the others' mean reward: then it is another one."""
    there = jnp.take_along_axis(trace, jnp.maximum(own, 0), axis=1)
    off = jnp.where(shared.kept, jnp.abs(there - _mean_there(trace, shared)), 0.0)
    as_many = jnp.sum(own >= 0, axis=1) == jnp.sum(shared.kept)
    theirs = (as_many & (off < 2 * near).all(axis=1))[:, None] & shared.kept
    found = shared.found | theirs
    share = jnp.where(shared.kept, jnp.mean(found, axis=0), 0.0).astype(shared.support.dtype)
    shared = shared._replace(
        frames=jnp.where(theirs, own, shared.frames), found=found, support=share
    )
    return shared._replace(level=_mean_there(trace, shared))


def _way(trace, length, least):
    """Traces scaled from 0 at the first frame to 1 at the last, if they climb at all."""
    start, end = trace[:, :1], jnp.take_along_axis(trace, length[:, None] - 1, axis=1)
    return (trace - start) / jnp.maximum(end - start, least)


def _shared(scale, own, length, prominence, support) -> SharedBoundaries:
    """The boundaries that traces share on a scale (B, T), with their levels on it."""
    shared = shared_boundaries(
        scale[:, :, None], own, length, tolerance=prominence, support=support
    )
    shared = shared._replace(level=_mean_there(scale, shared))

    def reached(scale, frames, found):
        """Sets missing boundaries to the first frame at the level after the previous one."""

        def place(before, one):
            level, frame, found, kept = one
            at = jnp.arange(len(scale))
            there = (at > before) & (at < frame) & (scale >= level - 0.25 * prominence)
            frame = jnp.where(found | ~there.any(), frame, jnp.argmax(there))
            return jnp.where(kept, frame, before), jnp.where(kept, frame, -1)

        return jax.lax.scan(place, -1, (shared.level, frames, found, shared.kept))[1]

    return shared._replace(frames=jax.vmap(reached)(scale, shared.frames, shared.found))


def _mean_there(trace, shared: SharedBoundaries) -> Float[Array, "M"]:
    """The mean of traces at each boundary, over those that show it."""
    there = jnp.take_along_axis(trace, jnp.maximum(shared.frames, 0), axis=1)
    total = jnp.sum(jnp.where(shared.found, there, 0.0), axis=0)
    mean = total / jnp.maximum(jnp.sum(shared.found, axis=0), 1).astype(total.dtype)
    return jnp.where(shared.kept, mean, 0.0)


def _alike(own: Int[Array, "B M"], shared: SharedBoundaries) -> Float[Array, ""]:
    """Dice's coefficient between the traces' own boundaries and the common ones."""
    count = jnp.sum(own >= 0) + jnp.sum(shared.kept) * len(own)
    return 2 * jnp.sum(shared.found) / jnp.maximum(count, 1)


@checked
def agreed_stages(
    reward: Float[Array, "B T"],
    length: Int[Array, "B"],
    *,
    prominence: Float[Array, ""] | float = 0.125,
    smoothing: int = 15,
    support: Float[Array, ""] | float = 0.5,
) -> tuple[Int[Array, ""], SharedBoundaries]:
    """The patience whose stages agree best between demonstrations, and the common stages.

    Too short a patience cuts rises at their pauses, here in two and there in three; too long a one
    passes over plateaus, here and not there. Alike is Dice's coefficient of the boundaries found in
    each trace and the common ones; one common boundary, which any trace has, counts as none. Of
    equally good patiences the shortest. A rise that only the shortest patience cuts is one stage.

    Args:
      reward, length, prominence, smoothing, support: as in `agreed_boundaries`.

    Its errors are the same.
    """
    shares = jnp.array(_SHARES)
    patiences = jnp.maximum(_FEWEST, jnp.round(shares * jnp.median(length))).astype(jnp.int32)
    trace = _smoothed(reward, length, smoothing)
    rule = {"prominence": prominence, "smoothing": smoothing}

    def agreement(patience):
        own = each_alone(reward, length, **rule, patience=patience)
        common = _common(trace, own, length, prominence, support)
        alike = jnp.where(jnp.sum(common.kept) >= 2, _alike(own, common), 0.0)
        return alike, _settled(trace, own, common, prominence)

    alike, each = jax.lax.map(agreement, patiences)
    best = jnp.where((alike[1:] > 0).any(), jnp.argmax(alike), len(shares) - 1)
    return patiences[best], jax.tree.map(lambda x: x[best], each)


@checked
def each_alone(reward: Float[Array, "B T"], length: Int[Array, "B"], **rule) -> Int[Array, "B M"]:
    """Frames that `transitions` marks in each trace, padded with -1; the options are its own, and
    errors are those of `transitions`."""
    within = jnp.arange(reward.shape[1]) < length[:, None]
    marked = jax.vmap(lambda x: transitions(x, **rule))(_held(reward, length)) & within
    return jax.vmap(lambda x: boundary_frames(x, MOST))(marked)


def _held(reward, length):
    """The trace held at its last value, which adds no boundary."""
    frames = jnp.minimum(jnp.arange(reward.shape[1]), length[:, None] - 1)
    return jnp.take_along_axis(reward, frames, axis=1)
