"""Measures of how well a reward rises with time along a video that ends in success.

Value-order correlation (VOC) is the correlation of a video's rewards with its frame indices.
Robometer (arXiv 2603.02115) reports Pearson's, GVL (arXiv 2411.04549) and OpenGVL (2509.17321)
report Spearman's. Kendall's tau-b of the same two is `gril_jax.metrics.kendall_tau`. All are in
[-1, 1] and 1 is best; Spearman and Kendall do not depend on the reward's scale or shape.

Everything here can be jitted. Shapes use B for videos and T for frames, padded to a common length;
`length` counts a video's frames before padding.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from gril_jax.types import checked

from .order import kendall_tau

_ROUNDING = 1e-5  # share of the largest reward by which equal rewards may differ


@checked
def voc_pearson(
    reward: Float[Array, "T"], length: Int[Array, ""] | int | None = None
) -> Float[Array, ""]:
    """Pearson's correlation of a video's rewards with their frame indices.

    It is 1 for a reward that rises by the same amount with every frame. It is 0 where it is not
    defined: a constant reward, or fewer than two frames.

    >>> float(voc_pearson(jnp.array([0.0, 1.0, 2.0])))
    1.0

    Args:
      reward: of each frame, in any unit.
      length: how many frames count; all if left out.
    """
    return _correlation(reward, _counted(reward, length))


@checked
def voc_spearman(
    reward: Float[Array, "T"], length: Int[Array, ""] | int | None = None
) -> Float[Array, ""]:
    """Spearman's correlation of a video's rewards with their frame indices.

    It is 1 for a reward that rises with every frame. Equal rewards share their mean rank. It is 0
    where it is not defined, as `voc_pearson`.

    >>> float(voc_spearman(jnp.array([0.0, 1.0, 100.0])))
    1.0

    Args:
      reward: of each frame, in any unit.
      length: how many frames count; all if left out.
    """
    counted = _counted(reward, length)
    below = (reward < reward[:, None]) & counted
    equal = (reward == reward[:, None]) & counted
    rank = jnp.sum(below, axis=1) + (jnp.sum(equal, axis=1) + 1) / 2  # from 1; ties share the mean
    return _correlation(rank, counted)


class TimeOrder(NamedTuple):
    """Correlations of rewards and time, means over videos; leaves are scalars."""

    voc_pearson: Float[Array, ""]
    voc_spearman: Float[Array, ""]
    reward_time_tau: Float[Array, ""]  # Kendall's tau-b


@checked
def time_order(reward: Float[Array, "B T"], length: Int[Array, "B"] | None = None) -> TimeOrder:
    """The three correlations of reward and time, each a mean over videos.

    Frames in which nothing moves have one reward, up to rounding. Rank correlations of such frames
    would be those of the rounding, so rewards are compared after `merge_ties`.

    Args:
      reward: of each frame of each video.
      length: frames before padding; all if left out.
    """
    length = jnp.full(reward.shape[0], reward.shape[1]) if length is None else length
    reward = jax.vmap(merge_ties)(reward, length)
    each = (jax.vmap(one)(reward, length) for one in (voc_pearson, voc_spearman, kendall_tau))
    return TimeOrder(*(jnp.mean(x) for x in each))


@checked
def merge_ties(
    reward: Float[Array, "T"], length: Int[Array, ""] | int | None = None
) -> Float[Array, "T"]:
    """The rewards, with those that differ by rounding alone made equal: the lowest of them.

    In order of size, two neighbours are equal if they differ by at most 1e-5 of the largest
    absolute reward. Padding becomes infinite.

    >>> merge_ties(jnp.array([-1.0, -0.9999999, -0.5])).tolist()
    [-1.0, -1.0, -0.5]

    Args:
      reward: of each frame, in any unit.
      length: how many frames count; all if left out.
    """
    counted = _counted(reward, length)
    kept = jnp.where(counted, reward, jnp.inf)
    order = jnp.argsort(kept)
    ranked = kept[order]
    near = _ROUNDING * jnp.max(jnp.where(counted, jnp.abs(reward), 0.0))
    begins = jnp.concatenate([jnp.ones(1, bool), jnp.diff(ranked) > near])
    first = jax.lax.cummax(jnp.where(begins, jnp.arange(len(ranked)), 0))
    return jnp.zeros_like(ranked).at[order].set(ranked[first])


def _counted(reward, length):
    frame = jnp.arange(reward.shape[0])
    return frame < (reward.shape[0] if length is None else length)


def _correlation(x, counted) -> Float[Array, ""]:
    """Pearson's correlation of counted values with their indices; 0 where it is not defined."""
    x = jnp.where(counted, x - x[0], 0.0)  # exactly 0 for constant values, whose mean is rounded
    x = x / jnp.maximum(jnp.max(jnp.abs(x)), jnp.finfo(x.dtype).tiny)  # squares stay finite
    x, time = (_centred(one, counted) for one in (x, jnp.arange(len(x)).astype(x.dtype)))
    spread = jnp.sqrt(jnp.sum(x * x)) * jnp.sqrt(jnp.sum(time * time))
    return jnp.clip(jnp.sum(x * time) / jnp.where(spread > 0, spread, 1.0), -1.0, 1.0)


def _centred(x, counted):
    mean = jnp.sum(jnp.where(counted, x, 0.0)) / jnp.maximum(jnp.sum(counted), 1).astype(x.dtype)
    return jnp.where(counted, x - mean, 0.0)
