"""How good is a latent or a reward: order, steps, and the separation ratio (Eq. 8).

Cycle consistency of latents has its own file, `gril_jax.metrics.cycles`; means over seeds with
their uncertainty are in `gril_jax.metrics.interquartile`.

Everything here can be jitted. Shapes use B for recordings, T and S for frames (padded to a
common length) and D for the latent; `length` counts a recording's frames before padding.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from gril_jax.errors import ConfigError, ShapeError

__all__ = [
    "alignment_tau",
    "kendall_tau",
    "mean_alignment_tau",
    "monotonicity",
    "reward_time_tau",
    "separation_ratio",
    "step_sharpness",
]


def kendall_tau(
    x: Float[Array, "T"] | Int[Array, "T"], length: Int[Array, ""] | int | None = None
) -> Float[Array, ""]:
    """Kendall's tau-b between a sequence and its own frame indices, in [-1, 1].

    Where tau is undefined (a constant sequence, or fewer than two frames) the value is 0: a
    collapsed latent orders nothing, and must not vanish from a mean as NaN would.

    Args:
      x: values in order of time; ties are allowed.
      length: how many of them count; all if left out.
    """
    frame = jnp.arange(x.shape[0])
    counted = frame[:, None] < frame
    if length is not None:
        counted &= frame < length
    order = jnp.where(counted, jnp.sign(x[None, :] - x[:, None]), 0).astype(jnp.float32)
    pairs, untied = jnp.sum(counted), jnp.sum(jnp.abs(order))
    # Frame indices have no ties, so tau-b's denominator is sqrt(all pairs * untied pairs).
    # Roots are taken one by one: their product stays exact enough where n^4 would not fit.
    denominator = jnp.sqrt(pairs.astype(jnp.float32)) * jnp.sqrt(untied)
    return jnp.sum(order) / jnp.where(untied > 0, denominator, 1.0)


def alignment_tau(
    query: Float[Array, "T D"],
    key: Float[Array, "S D"],
    query_length: Int[Array, ""] | int | None = None,
    key_length: Int[Array, ""] | int | None = None,
) -> Float[Array, ""]:
    """Whether one video's nearest neighbours in another come in order of time (as in XIRL).

    1 if they advance with every query frame, -1 if they run backwards.

    Args:
      query: latents of the video whose frames look for neighbours.
      key: latents of the video they look in.
      query_length: frames of `query` that count; all if left out.
      key_length: the same for `key`.
    """
    distance = jnp.sum(jnp.square(key), axis=-1) - 2.0 * jnp.matmul(
        query, key.T, precision="highest"
    )
    if key_length is not None:
        distance = jnp.where(jnp.arange(key.shape[0]) < key_length, distance, jnp.inf)
    return kendall_tau(jnp.argmin(distance, axis=-1), query_length)


def mean_alignment_tau(
    latents: Float[Array, "B T D"], length: Int[Array, "B"] | None = None
) -> Float[Array, ""]:
    """Mean of `alignment_tau` over all ordered pairs of different videos; 0 for one video."""
    num_videos, num_frames, _ = latents.shape
    if length is None:
        length = jnp.full(num_videos, num_frames)

    def from_query(query):  # one row of pairs at a time: memory grows with B T^2, not B^2 T^2
        against_all = jax.vmap(alignment_tau, in_axes=(None, 0, None, 0))
        return against_all(latents[query], latents, length[query], length)

    taus = jax.lax.map(from_query, jnp.arange(num_videos))
    others = ~jnp.eye(num_videos, dtype=bool)
    return jnp.sum(jnp.where(others, taus, 0.0)) / max(num_videos * (num_videos - 1), 1)


def reward_time_tau(
    reward: Float[Array, "T"], length: Int[Array, ""] | int | None = None
) -> Float[Array, ""]:
    """Kendall's tau-b between a reward trace and time: 1 if it rises with every frame."""
    return kendall_tau(reward, length)


def monotonicity(
    reward: Float[Array, "T"], length: Int[Array, ""] | int | None = None
) -> Float[Array, ""]:
    """Net change of a trace over its total variation, in [-1, 1]: 1 if it never falls.

    Kendall's tau counts pairs of frames, so a tremble on a plateau costs as much as a deep
    fall; here each fall costs its height. A trace that does not move at all has 0.

    >>> float(monotonicity(jnp.array([0.0, 4.0, 3.0, 2.0])))
    0.3333333432674408
    """
    change = _changes(reward, length)
    variation = jnp.sum(jnp.abs(change))
    return jnp.sum(change) / jnp.where(variation > 0, variation, 1.0)


def step_sharpness(
    reward: Float[Array, "T"],
    boundary: Bool[Array, "T"],
    length: Int[Array, ""] | int | None = None,
    *,
    window: int = 5,
) -> Float[Array, ""]:
    """How far a trace rises in steps at the stages' ends, beyond what an even ramp would do.

    With s the net rise within `window` frames of a boundary over the total variation of the
    trace, and c the share of all frame-to-frame changes that lie there, it is (s - c) / (1 - c),
    as Cohen's kappa corrects for chance. 1: it rises there and is flat elsewhere. 0: an even
    ramp, whatever the number of boundaries and the window. Negative: it moves elsewhere, or
    falls. Falls and noise between the steps count against it, which a share of the net rise
    would not show: a trace that gives back on plateaus what it won in steps is no staircase.

    The value does not change with the trace's offset, positive scale or padding. It is 0 where
    it says nothing: a constant trace, no boundary, or boundaries everywhere.

    Args:
      reward: of each frame.
      boundary: frames at which a stage ends, true ones or found ones.
      length: how many frames count; all if left out.
      window: how far from a boundary a change may lie, in frames; the change from frame t - 1 to
        t lies at t.

    Raises:
      ConfigError: the window is negative.
      ShapeError: reward and boundary differ in shape.
    """
    if window < 0:
        raise ConfigError(f"window is {window}; it must be at least 0.")
    if reward.shape != boundary.shape:
        raise ShapeError(
            f"reward has shape {reward.shape} but boundary has shape {boundary.shape}."
        )
    frame = jnp.arange(reward.shape[0])
    counted = frame[1:] < (reward.shape[0] if length is None else length)
    ends = boundary & (frame < (reward.shape[0] if length is None else length))
    reached = jnp.cumsum(jnp.pad(ends, (window + 1, window)).astype(jnp.int32))
    near = (reached[2 * window + 1 :] - reached[: -2 * window - 1] > 0)[1:] & counted
    change = _changes(reward, length)
    variation = jnp.sum(jnp.abs(change))
    share = jnp.sum(jnp.where(near, change, 0.0)) / jnp.where(variation > 0, variation, 1.0)
    num_near, num_changes = jnp.sum(near), jnp.sum(counted)
    cover = num_near / jnp.maximum(num_changes, 1)
    says = (variation > 0) & (num_near > 0) & (num_near < num_changes)
    return jnp.where(says, (share - cover) / jnp.where(says, 1.0 - cover, 1.0), 0.0)


def separation_ratio(
    reward: Float[Array, "B T"],
    success: Bool[Array, "B"],
    length: Int[Array, "B"] | None = None,
) -> Float[Array, ""]:
    """Mean |cumulative reward| of successes over that of failures (Eq. 8); lower is better.

    Below 1 the reward tells them apart. NaN if either kind is missing, since the ratio then
    says nothing.

    Args:
      reward: of each frame; at most 0 for a learned reward.
      success: recordings that finish the task.
      length: frames that count; all if left out.
    """
    if length is not None:
        reward = jnp.where(jnp.arange(reward.shape[1]) < length[:, None], reward, 0.0)
    cost = jnp.abs(jnp.sum(reward, axis=1))
    positive = jnp.sum(jnp.where(success, cost, 0.0)) / jnp.sum(success)
    negative = jnp.sum(jnp.where(success, 0.0, cost)) / jnp.sum(~success)
    return positive / negative


def _changes(reward: Float[Array, "T"], length) -> Float[Array, "T-1"]:
    """From each frame to the next, 0 in padding; scaled so that no sum overflows."""
    if length is not None:
        reward = jnp.where(jnp.arange(reward.shape[0]) < length, reward, reward[:1])
    counted = jnp.arange(1, reward.shape[0]) < (reward.shape[0] if length is None else length)
    # The bound keeps the divisor's reciprocal a normal number, where a compiler may take that.
    largest = jnp.minimum(jnp.max(jnp.abs(reward), initial=0.0), 1e37)
    reward = reward / jnp.where(largest > 0, largest, 1.0)
    return jnp.where(counted, jnp.diff(reward), 0.0)
