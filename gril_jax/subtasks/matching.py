"""Matches stage boundaries in order: with the true ones, and across demonstrations.

    found = boundary_frames(transitions(reward), 8)
    pairs = match_within(found, true, tolerance=5)
    shared = shared_boundaries(rewards[:, :, None], found_in_each, length, tolerance=0.2)

Lists of frames have a static size, increase, and are filled up with -1. Everything can be jitted
and vmapped. Shapes use B for demonstrations, T for frames, D for features of a frame, and M and
N for boundaries.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from gril_jax.errors import ConfigError, ShapeError
from gril_jax.types import checked


class SharedBoundaries(NamedTuple):
    """The same stages in every demonstration; kept ones come first, in order of time."""

    frames: Int[Array, "B M"]  # increasing; -1 in slots that are not kept
    kept: Bool[Array, "M"]
    support: Float[Array, "M"]  # share of the demonstrations in which it was found; 0 if not kept
    found: Bool[Array, "B M"]  # it was found there; if not, it was placed
    level: Float[Array, "M"] | None = None  # mean reward at it, where it is one of reward traces


@checked
def boundary_frames(boundary: Bool[Array, "T"], size: int) -> Int[Array, "M"]:
    """The first `size` marked frames, padded with -1.

    >>> boundary_frames(jnp.array([False, True, False, True]), 3).tolist()
    [1, 3, -1]
    """
    return jnp.nonzero(boundary, size=size, fill_value=-1)[0]


@checked
def match_within(
    found: Int[Array, "M"], true: Int[Array, "N"], *, tolerance: int = 5
) -> Int[Array, "M"]:
    """The true boundary of each found one, or -1.

    Pairs are one-to-one, in order, and at most `tolerance` frames apart: as many of them as
    there can be, and of those matchings the one with the least total distance.

    Args:
      found: frames, increasing, filled up with -1.
      true: the same.
      tolerance: in frames.
    """
    distance = jnp.abs(found[:, None] - true).astype(jnp.float32)
    near = (distance <= tolerance) & (found[:, None] >= 0) & (true >= 0)
    # One more pair counts more than all distances together can.
    worth = 1.0 + tolerance * (1.0 + min(distance.shape))
    return match_in_order(jnp.where(near, worth - distance, 0.0))


@checked
def match_in_order(gain: Float[Array, "M N"]) -> Int[Array, "M"]:
    """The one-to-one matching of rows with columns, in order, with the largest total gain.

    Dynamic programming over the table (Needleman and Wunsch 1970), with no cost for leaving
    rows and columns out. Pairs without positive gain are never matched.

    >>> match_in_order(jnp.array([[0.0, 2.0], [3.0, 0.0], [0.0, 2.0]])).tolist()
    [-1, 0, 1]

    Returns:
      The column of each row, increasing, or -1.
    """
    num_rows, num_columns = gain.shape
    if not gain.size:
        return jnp.full(num_rows, -1, jnp.int32)

    def add_row(best, gain):  # best[j]: total with the rows so far and the first j columns
        # Not `best.at[1:].max`: XLA for CPU (jax 0.10.2) updates in place what it still reads.
        paired = jnp.pad(best[:-1] + jnp.where(gain > 0, gain, -jnp.inf), (1, 0))
        row = jax.lax.cummax(jnp.maximum(best, paired))
        return row, (best, row)

    start = jnp.zeros(num_columns + 1, gain.dtype)
    _, (without, rows) = jax.lax.scan(add_row, start, gain)

    def trace_back(limit, tables):  # `limit` columns are still free
        without, row = tables
        column = jnp.argmax(row == row[limit]) - 1  # of the first, so the pairing itself
        matched = row[limit] > without[limit]
        return jnp.where(matched, column, limit), jnp.where(matched, column, -1)

    _, match = jax.lax.scan(trace_back, num_columns, (without, rows), reverse=True)
    return match.astype(jnp.int32)


@checked
def place_in_order(
    cost: Float[Array, "M T"],
    kept: Bool[Array, "M"] | None = None,
    length: Int[Array, ""] | int | None = None,
) -> Int[Array, "M"]:
    """A frame for each row, strictly increasing, with the least total cost.

    >>> place_in_order(jnp.array([[5.0, 1.0, 0.0], [5.0, 5.0, 2.0]])).tolist()
    [1, 2]

    Args:
      cost: of placing each row at each frame, finite.
      kept: rows to place; the others get -1. All if left out.
      length: how many frames there are; all if left out.

    Returns:
      Frames below `length`; if there are fewer frames than rows to place, the surplus rows
      share the last frame.
    """
    num_rows, num_frames = cost.shape
    kept = jnp.ones(num_rows, bool) if kept is None else kept
    length = num_frames if length is None else length
    frames = jnp.arange(num_frames)
    rank = jnp.cumsum(kept) - 1

    def add_row(before, inputs):  # before[t]: least total if the next row is placed at t
        cost, kept = inputs
        total = jnp.where(frames < length, cost + before, jnp.inf)
        least = jax.lax.cummin(total)
        after = jnp.concatenate([jnp.full(1, jnp.inf, total.dtype), least[:-1]])
        return jnp.where(kept, after, before), total

    _, totals = jax.lax.scan(add_row, jnp.zeros(num_frames, cost.dtype), (cost, kept))

    def trace_back(limit, inputs):
        total, kept = inputs
        frame = jnp.argmin(jnp.where(frames < limit, total, jnp.inf))
        return jnp.where(kept, frame, limit), frame

    _, placed = jax.lax.scan(trace_back, num_frames, (totals, kept), reverse=True)
    fits = jnp.sum(kept) <= length
    placed = jnp.where(fits, placed, jnp.minimum(rank, jnp.maximum(length - 1, 0)))
    return jnp.where(kept, placed, -1).astype(jnp.int32)


@checked
def shared_boundaries(
    features: Float[Array, "B T D"],
    found: Int[Array, "B M"],
    length: Int[Array, "B"] | None = None,
    *,
    tolerance: Float[Array, ""] | float,
    support: Float[Array, ""] | float = 0.5,
) -> SharedBoundaries:
    """The boundaries shared by demonstrations of one task, in each of them.

    Detectors find more in one demonstration and less in another. Here the demonstration that
    agrees best with all others is taken as reference; its boundaries are matched in order with
    those of each other by their features; what enough demonstrations have is kept, and placed
    where a demonstration lacks it: at the frame, in order, with the most similar features.

    Args:
      features: what tells stages apart: latents, or a reward trace as D = 1.
      found: boundaries of each demonstration, frames, increasing, filled up with -1.
      length: frames before padding; all if left out.
      tolerance: how far apart, in feature units (Euclidean), the same boundary may be in two
        demonstrations.
      support: least share of the demonstrations, the reference included, that must have found a
        boundary.

    Raises:
      ShapeError: features and boundaries are of different demonstrations.
      ConfigError: the tolerance is known and not positive.
    """
    if features.ndim != 3 or found.ndim != 2 or features.shape[0] != found.shape[0]:
        raise ShapeError(
            f"features has shape {features.shape} but found has shape {found.shape}; they must "
            f"be (demonstrations, frames, D) and (demonstrations, boundaries)."
        )
    if not isinstance(tolerance, jax.core.Tracer) and not float(tolerance) > 0:
        raise ConfigError(f"tolerance is {tolerance}; it must be positive.")
    num_demos, num_frames, _ = features.shape
    length = jnp.full(num_demos, num_frames) if length is None else length
    features = jnp.clip(features / tolerance, -1e15, 1e15)  # one unit is now the tolerance
    at_found = jnp.take_along_axis(features, jnp.maximum(found, 0)[:, :, None], axis=1)

    def match(one, other):  # the boundaries of one demonstration in another
        distance = jnp.sum(jnp.square(at_found[one][:, None] - at_found[other]), axis=-1)
        both = (found[one] >= 0)[:, None] & (found[other] >= 0)
        gain = jnp.where(both, jnp.maximum(1.0 - distance, 0.0), 0.0)
        columns = match_in_order(gain)
        matched = jnp.take_along_axis(gain, columns[:, None], axis=1)[:, 0]
        return columns, jnp.sum(jnp.where(columns >= 0, matched, 0.0))

    demos = jnp.arange(num_demos)
    columns, agreement = jax.vmap(lambda i: jax.vmap(lambda j: match(i, j))(demos))(demos)
    columns = columns[jnp.argmax(jnp.sum(agreement, axis=1))]  # (B, M), from the reference
    was_found = columns >= 0
    share = jnp.mean(was_found, axis=0)
    kept = (share >= support) & jnp.any(was_found, axis=0)

    frames = jnp.take_along_axis(found, columns, axis=1)
    there = jnp.take_along_axis(at_found, columns[:, :, None], axis=1)
    typical = jnp.sum(jnp.where(was_found[:, :, None], there, 0.0), axis=0)
    times = jnp.maximum(jnp.sum(was_found, axis=0), 1).astype(typical.dtype)
    typical = typical / times[:, None]

    def place(features, frames, was_found, length):
        cost = jnp.sum(jnp.square(features - typical[:, None]), axis=-1)
        # What was found stays, unless a boundary before or after it would have no frame left.
        elsewhere = was_found[:, None] & (jnp.arange(num_frames) != frames[:, None])
        return place_in_order(jnp.minimum(cost, 1e2) + jnp.where(elsewhere, 1e4, 0.0), kept, length)

    placed = jax.vmap(place)(features, frames, was_found, length)
    first = jnp.argsort(~kept, stable=True)
    return SharedBoundaries(
        placed[:, first],
        kept[first],
        jnp.where(kept, share, 0.0)[first],
        (was_found & kept)[:, first],
    )
