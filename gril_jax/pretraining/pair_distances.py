"""Ranges that statistics of pairs have at the ends of videos, and what it costs to be out of them.

    ranges = learned(ends, frames, weight, box)       # of statistics, once
    cost = beyond(ranges, values, box, near_cost_fraction)

The statistics are those of `gril_jax.graphs.pair_statistics`.

Their weights are learned: a statistic counts as much as its range tells ends from other scenes.
Those are the frames of the videos, and the ends with their things in each other's places. The
weight is the logarithm of how much rarer they are in the range than ends are, of the rarer ones.
The worst statistic has most of the cost, since a scene that lacks one feature is no end. The mean
of all has the rest, since it has a slope wherever one of them is out.

Shapes use K = 5 for kinds of pairs and Q = 8 for statistics.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from gril_jax.graphs.pair_statistics import KINDS, STATISTICS

_TAIL = 0.1  # share of the ends that a range leaves out on each side
_WIDER = 0.25  # widths of a range by which it is made wider on each side: ends are few
_RARE = (1e-3, 1e-2)  # least shares of frames, and of exchanged ends, that are in a range
_TELLS = 0.1  # share of the best statistic's weight below which another one does not count
_REACH = 0.5  # world units over which the rest of a cost grows
_NARROW = 0.25  # half boxes over which the first share of a cost grows, at least
_WORST = 0.8  # share of the cost that is the worst statistic's; the mean's is the rest


class Ranges(NamedTuple):
    """Ranges of statistics; those without weight do not count."""

    nearest: Float[Array, "K Q"]
    furthest: Float[Array, "K Q"]
    weight: Float[Array, "K Q"]  # they sum to 1, or all are 0


def learned(
    ends: Float[Array, "B K Q"],
    frames: Float[Array, "B T K Q"],
    share: Float[Array, "B T"],
    exchanged: Float[Array, "B M K Q"],
    some: Bool[Array, "K"],
) -> Ranges:
    """Ranges of the ends of B videos, and their weights.

    Args:
      ends, frames: statistics of last frames and of all frames.
      share: what each frame counts; they sum to 1.
      exchanged: statistics of last frames whose things are in each other's places, in M ways.
      some: kinds of which all videos have pairs.
    """
    low, high = jnp.quantile(ends, jnp.array([_TAIL, 1.0 - _TAIL]), axis=0)
    within = lambda x: ((low <= x) & (x <= high)).astype(x.dtype)  # noqa: E731
    often = jnp.einsum("bt,btkq->kq", share, within(frames)) + _RARE[0]
    rarer = jnp.minimum(often, within(exchanged).mean(axis=(0, 1)) + _RARE[1])
    tells = jnp.log((within(ends).mean(axis=0) + _RARE[0]) / rarer)
    tells = jnp.where(some[:, None] & (tells > _TELLS * tells.max()), jnp.maximum(tells, 0.0), 0.0)
    wider = _WIDER * (high - low)
    return Ranges(low - wider, high + wider, tells / jnp.maximum(tells.sum(), 1e-6))


def beyond(
    ranges: Ranges,
    values: Float[Array, "K Q"],
    half_box: Float[Array, ""],
    near_cost_fraction: Float[Array, ""] | float,
) -> Float[Array, ""]:
    """Cost of statistics that are out of their ranges; 0 where none is.

    The fraction `near_cost_fraction` applies at once where a value is out by about its range's
    width, clipped to between a quarter of `half_box` and all of it. The rest grows in proportion.
    """
    out = jax.nn.relu(jnp.maximum(ranges.nearest - values, values - ranges.furthest))
    width = (ranges.furthest - ranges.nearest) / (1.0 + 2.0 * _WIDER) / 2.0
    scale = jnp.clip(width, _NARROW * half_box, half_box)
    cost = (
        near_cost_fraction * jnp.minimum(out / scale, 1.0)
        + (1.0 - near_cost_fraction) * out / _REACH
    )
    relative = ranges.weight / jnp.maximum(ranges.weight.max(), 1e-6)
    return (1.0 - _WORST) * jnp.sum(ranges.weight * cost) + _WORST * jnp.max(relative * cost)


def nothing() -> Ranges:
    """Ranges of which none counts."""
    none = jnp.zeros((KINDS, STATISTICS))
    return Ranges(none, none, none)
