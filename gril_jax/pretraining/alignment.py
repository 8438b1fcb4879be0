"""Losses that align videos in time: functions of one batch, which the table `ALIGNMENTS` names.

Each takes a key, the latents (V, F, D) of frames, their normalised times (V, F), which of them are
valid (V, F), the cycle-consistency through all videos, which is computed in any case, and the
traced options; it returns its weighted loss.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from gril_jax.config.tables import ALIGNMENTS, find
from gril_jax.losses import mean_consistency, soft_dtw_divergence, stochastic_consistency

from .options import Hyper, PixelStatic, Static


def aligned(
    key: PRNGKeyArray,
    latents: Float[Array, "V F D"],
    times: Float[Array, "V F"],
    valid: Bool[Array, "V F"],
    hyper: Hyper,
    config: Static | PixelStatic,
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The loss that the options name, and the time agreement that helps it to begin."""
    chosen = ALIGNMENTS[config.consistency]
    how = dict(form=chosen.form, temperature=hyper.temperature, similarity=chosen.similarity)
    plain, agreement = mean_consistency(latents, times, valid, **how)
    losses = [find(name)(key, latents, times, valid, plain, hyper) for name in chosen.losses]
    return sum(losses[1:], start=losses[0]), agreement


def cycle(
    key: PRNGKeyArray,
    latents: Float[Array, "V F D"],
    times: Float[Array, "V F"],
    valid: Bool[Array, "V F"],
    plain: Float[Array, ""],
    hyper: Hyper,
) -> Float[Array, ""]:
    """Temporal cycle-consistency of every frame through every other video."""
    del key, latents, times, valid, hyper
    return plain


def sampled_cycle(
    key: PRNGKeyArray,
    latents: Float[Array, "V F D"],
    times: Float[Array, "V F"],
    valid: Bool[Array, "V F"],
    plain: Float[Array, ""],
    hyper: Hyper,
) -> Float[Array, ""]:
    """Temporal cycle-consistency of as many randomly sampled cycles."""
    del plain
    return stochastic_consistency(key, latents, times, valid, temperature=hyper.temperature)


def warping(
    key: PRNGKeyArray,
    latents: Float[Array, "V F D"],
    times: Float[Array, "V F"],
    valid: Bool[Array, "V F"],
    plain: Float[Array, ""],
    hyper: Hyper,
) -> Float[Array, ""]:
    """Soft-DTW divergence per frame, mean over all pairs of videos."""
    del key, times, plain
    one, other = jnp.triu_indices(latents.shape[0], 1)
    length = jnp.sum(valid, axis=1)  # valid frames come first
    divergence = soft_dtw_divergence(
        latents[one], latents[other], length[one], length[other], gamma=hyper.gamma
    )
    frames = jnp.maximum(length[one] + length[other], 1)
    return hyper.soft_dtw_weight * jnp.mean(divergence / frames)
