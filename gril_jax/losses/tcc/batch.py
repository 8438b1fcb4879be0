"""The temporal cycle-consistency loss of a batch of videos: the mean over all ordered pairs.

    loss = mean_cycle_consistency(latents, times, form="classification", similarity="cosine")

All pairs go through the same few products, with memory for B^2 T^2 numbers. Shapes use B for
videos, T for frames and D for the latent.
"""

import functools
from typing import Unpack

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .cycle import CycleOptions, prepared_agreement, prepared_cycle, resolved
from .soft_neighbour import check_batch, prepare


def mean_cycle_consistency(
    latents: Float[Array, "B T D"],
    times: Float[Array, "B T"],
    valid: Bool[Array, "B T"] | None = None,
    **options: Unpack[CycleOptions],
) -> Float[Array, ""]:
    """Mean of `cycle_consistency` over all ordered pairs of different videos: the TCC loss.

    >>> twice = 9.0 * jnp.tile(jnp.eye(4), (2, 1, 1))  # a video and itself: every frame comes home
    >>> times = jnp.tile(jnp.arange(4.0) / 4, (2, 1))
    >>> round(float(mean_cycle_consistency(twice, times, temperature=0.1)), 6)
    0.0

    Args:
      latents: of each video's frames.
      times: of those frames, as shares of their video: frame index / video length.
      valid: False for padding; only valid frames count.
      options: `CycleOptions`.

    Returns:
      The mean over all valid frames of all pairs; 0 if there is none, as for a single video.

    Raises:
      ShapeError: the arrays do not fit together.
      ConfigError: an option is unknown, or a value known at trace time is not positive.
    """
    return mean_consistency(latents, times, valid, **options)[0]


def mean_consistency(
    latents: Float[Array, "B T D"],
    times: Float[Array, "B T"],
    valid: Bool[Array, "B T"] | None = None,
    **options: Unpack[CycleOptions],
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """`mean_cycle_consistency`, and the mean squared difference between a frame's time and that of
    its soft neighbour, from the same matches.

    A cycle closes just as well if two videos agree on a scrambled order of events, and training
    does get stuck there. The second term knows which way time runs; it is for the first updates
    only, since it also punishes a demonstrator who takes longer over one stage. Arguments and
    errors are the same.
    """
    matching, form = resolved(**options)

    def pair(query, time, query_valid, other, other_time, other_valid):
        valid = query_valid, other_valid
        cycle = prepared_cycle(query, other, time, *valid, matching, form)
        return cycle, prepared_agreement(query, other, time, other_time, *valid, matching)

    check_batch(latents, times, valid)
    latents = prepare(latents, valid, unit=matching["unit"])
    num_videos, num_frames, _ = latents.shape
    ordered = num_videos * (num_videos - 1)
    if not ordered:
        return jnp.zeros((), latents.dtype), jnp.zeros((), latents.dtype)
    total = ordered * num_frames if valid is None else jnp.sum(_pairs_per_frame(valid))

    def errors(asked, answering):
        return jax.vmap(functools.partial(pair, *asked))(*answering)

    videos = (latents, times, valid)
    others = jnp.array([[j for j in range(num_videos) if j != i] for i in range(num_videos)])
    answering = jax.tree.map(lambda x: jnp.take(x, others, axis=0, mode="clip"), videos)
    cycle, agreement = jax.tree.map(jnp.sum, jax.vmap(errors)(videos, answering))
    return tuple(x / jnp.maximum(total, 1).astype(x.dtype) for x in (cycle, agreement))


def _pairs_per_frame(valid):
    """Number of pairs in which each frame is a query: one per other video with a valid frame."""
    filled = jnp.any(valid, axis=1)
    others = jnp.sum(filled) - filled.astype(jnp.int32)
    return jnp.where(valid, others[:, None], 0)
