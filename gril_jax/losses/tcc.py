"""Temporal cycle-consistency by regression (Dwibedi et al., CVPR 2019, as XIRL uses it).

A frame of one video finds its soft nearest neighbour in another video; that neighbour looks
back, and must land at the time it came from. Only the order of events is needed: no actions, no
labels. Shapes use B for videos, T and S for frames and D for the latent.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

__all__ = ["cycle_consistency", "mean_consistency", "time_agreement"]

# Logit of a frame that does not count. Finite, so that a video without any valid frame gives
# uniform weights and zero gradients where -inf would give NaN.
_HIDDEN = -1e9


def cycle_consistency(
    query: Float[Array, "T D"],
    other: Float[Array, "S D"],
    times: Float[Array, "T"],
    query_valid: Bool[Array, "T"] | None = None,
    other_valid: Bool[Array, "S"] | None = None,
    *,
    temperature: Float[Array, ""] | float = 1.0,
) -> Float[Array, "T"]:
    """Squared error of each query frame's time after going to the other video and back.

    Similarity is minus the squared distance divided by D and by the temperature, both ways.

    Args:
      query: latents of the video that is asked.
      other: latents of the video that answers.
      times: of the query frames, usually frame index / video length, in [0, 1].
      query_valid: False for padding, which gets value 0 and is never matched.
      other_valid: the same for the other video.
      temperature: of both softmaxes; large values blur the match over many frames.

    Returns:
      One non-negative value per query frame, not averaged.
    """
    there = _match(query, other, other_valid, temperature)
    neighbour = jnp.matmul(there, other, precision="highest")
    back = _match(neighbour, query, query_valid, temperature)
    error = jnp.square(back @ times - times)
    return error if query_valid is None else jnp.where(query_valid, error, 0.0)


def time_agreement(
    query: Float[Array, "T D"],
    other: Float[Array, "S D"],
    times: Float[Array, "T"],
    other_times: Float[Array, "S"],
    query_valid: Bool[Array, "T"] | None = None,
    other_valid: Bool[Array, "S"] | None = None,
    *,
    temperature: Float[Array, ""] | float = 1.0,
) -> Float[Array, "T"]:
    """Squared difference between each query frame's time and its soft neighbour's.

    A cycle closes just as well if two videos agree on a scrambled order of events, and training
    does get stuck there. This term knows which way time runs; it is for the first updates only,
    since it also punishes a demonstrator who takes longer over one stage.

    Args and returns as for `cycle_consistency`, with the times of the other video's frames too.
    """
    there = _match(query, other, other_valid, temperature)
    error = jnp.square(there @ other_times - times)
    return error if query_valid is None else jnp.where(query_valid, error, 0.0)


def mean_consistency(
    latents: Float[Array, "B T D"],
    times: Float[Array, "B T"],
    valid: Bool[Array, "B T"] | None = None,
    *,
    temperature: Float[Array, ""] | float = 1.0,
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Means of `cycle_consistency` and `time_agreement` over all ordered pairs of videos.

    All pairs go through the same few batched products; memory grows with B^2 T^2. Only valid
    frames count. A single video has no pair, and gives 0.
    """
    if valid is None:
        valid = jnp.ones(times.shape, bool)

    def pair(query, time, query_valid, other, other_time, other_valid):
        masks = {"query_valid": query_valid, "other_valid": other_valid}
        masks["temperature"] = temperature
        cycle = cycle_consistency(query, other, time, **masks)
        return cycle, time_agreement(query, other, time, other_time, **masks)

    against_all = jax.vmap(pair, in_axes=(None, None, None, 0, 0, 0))
    errors = jax.vmap(against_all, in_axes=(0, 0, 0, None, None, None))(
        latents, times, valid, latents, times, valid
    )  # two of (query video, other video, frame)
    counted = valid[:, None] & ~jnp.eye(len(times), dtype=bool)[:, :, None]
    counted = jnp.broadcast_to(counted, errors[0].shape)
    total = jnp.maximum(jnp.sum(counted), 1)
    cycle, agreement = (jnp.sum(jnp.where(counted, e, 0.0)) / total for e in errors)
    return cycle, agreement


def _match(query, keys, valid, temperature):
    """Softmax over `keys` of minus the squared distance to each query, (T, S).

    The query's own square is the same for all keys and cancels in the softmax; leaving it out
    saves a pass over the largest array, and digits when latents lie far from zero.
    """
    products = jnp.matmul(query, keys.T, precision="highest")
    closeness = 2.0 * products - jnp.sum(jnp.square(keys), axis=-1)
    logits = closeness / (keys.shape[-1] * temperature)
    if valid is not None:
        logits = jnp.where(valid, logits, _HIDDEN)
    return jax.nn.softmax(logits, axis=-1)
