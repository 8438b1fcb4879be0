"""Separation of success from failure by a reward, and of later stages from earlier ones.

The separation ratio (Eq. 8) divides sums over time, which depend on how long a
recording is: a failure that breaks off early has a small sum. So sums are made comparable first
(`cumulative`). Two other measures do not depend on the reward's scale: the area under the ROC
curve, and the order of stages. Everything can be jitted. Shapes use B for
recordings, T for frames (padded to a common length); `length` counts frames before padding.
"""

from typing import Literal

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from gril_jax.types import checked

Convention = Literal["natural", "resampled", "held"]
CONVENTIONS: tuple[Convention, ...] = ("natural", "resampled", "held")


def cumulative(
    reward: Float[Array, "B T"], length: Int[Array, "B"], convention: Convention
) -> Float[Array, "B"]:
    """The sum of each recording's rewards.

    Args:
      reward: of each frame.
      length: frames that count.
      convention: which frames are summed.
        "natural"    those there are
        "resampled"  T of them: each recording is stretched evenly, which keeps its mean reward
        "held"       T of them: what a recording ends with goes on, as in an episode of fixed length
    """
    num_frames = reward.shape[1]
    counted = jnp.arange(num_frames) < length[:, None]
    total = jnp.sum(jnp.where(counted, reward, 0.0), axis=1)
    if convention == "resampled":
        return total * num_frames / length
    if convention == "held":
        last = jnp.take_along_axis(reward, length[:, None] - 1, axis=1)[:, 0]
        return total + (num_frames - length) * last
    return total


def ratio(total: Float[Array, "B"], success: Bool[Array, "B"]) -> Float[Array, ""]:
    """Mean |cumulative reward| of successes over that of failures (Eq. 8); lower is better.

    NaN if either kind is missing.

    >>> float(ratio(jnp.array([-1.0, -4.0]), jnp.array([True, False])))
    0.25
    """
    cost = jnp.abs(total)
    succeeded, failed = (jnp.sum(x).astype(cost.dtype) for x in (success, ~success))
    positive = jnp.sum(jnp.where(success, cost, 0.0)) / succeeded
    return positive / (jnp.sum(jnp.where(success, 0.0, cost)) / failed)


@checked
def success_auc(score: Float[Array, "B"], success: Bool[Array, "B"]) -> Float[Array, ""]:
    """Probability that a success scores higher than a failure; ties count half.

    The area under the ROC curve (Mann and Whitney 1947): 1 if all successes are above all
    failures, 0.5 for a score that says nothing, NaN if either kind is missing.

    >>> float(success_auc(jnp.array([0.0, -0.5, -0.2]), jnp.array([True, False, True])))
    1.0
    """
    ties = jnp.where(score[:, None] == score, 0.5, 0.0)
    above = jnp.where(score[:, None] > score, 1.0, ties)
    pairs = success[:, None] & ~success
    return jnp.sum(jnp.where(pairs, above, 0.0)) / jnp.sum(pairs).astype(above.dtype)


@checked
def stage_order(
    reward: Float[Array, "T"], stage: Int[Array, "T"], length: Int[Array, ""] | int | None = None
) -> Float[Array, ""]:
    """Rank correlation of a reward with the number of stages that are done, in [-1, 1].

    Somers' D (1962) over all pairs of frames with different numbers of stages done: the share in
    which the later one has the higher reward, less the share in which it has the lower one. It is
    1 if every frame of a later stage has a higher reward than every frame before it. Differences
    within a stage do not count. It is 0 if there is no such pair.

    >>> float(stage_order(jnp.array([-1.0, -0.9, -0.5]), jnp.array([0, 0, 1])))
    1.0

    Args:
      reward: of each frame.
      stage: stages done in each frame.
      length: how many frames count; all if left out.
    """
    num_frames = reward.shape[0]
    counted = jnp.arange(num_frames) < (num_frames if length is None else length)
    pairs = (stage[:, None] < stage) & counted[:, None] & counted
    agree = jnp.where(pairs, jnp.sign(reward[None] - reward[:, None]), 0.0)
    return jnp.sum(agree) / jnp.maximum(jnp.sum(pairs), 1).astype(agree.dtype)
