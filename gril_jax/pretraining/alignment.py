"""Losses that align videos in time, which the table `ALIGNMENTS` names: functions of one batch."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from gril_jax.config.tables import ALIGNMENTS, find
from gril_jax.losses import mean_consistency, soft_dtw_divergence, stochastic_consistency

from .options import Hyper, PixelStatic, Static


class Frames(NamedTuple):
    """The frames of a batch of videos, and what a loss may use."""

    key: PRNGKeyArray
    latents: Float[Array, "V F D"]
    times: Float[Array, "V F"]  # as shares of their video
    valid: Bool[Array, "V F"]
    plain: Float[Array, ""]  # cycle-consistency through all videos, computed in any case
    hyper: Hyper


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
    frames = Frames(key, latents, times, valid, plain, hyper)
    losses = [find(name)(frames) for name in chosen.losses]
    return sum(losses[1:], start=losses[0]), agreement


def cycle(frames: Frames) -> Float[Array, ""]:
    """Temporal cycle-consistency of every frame through every other video."""
    return frames.plain


def sampled_cycle(frames: Frames) -> Float[Array, ""]:
    """Temporal cycle-consistency of as many randomly sampled cycles."""
    temperature = frames.hyper.temperature
    return stochastic_consistency(*frames[:4], temperature=temperature)


def warping(frames: Frames) -> Float[Array, ""]:
    """Soft-DTW divergence per frame, mean over all pairs of videos."""
    latents = frames.latents
    one, other = jnp.triu_indices(latents.shape[0], 1)
    length = jnp.sum(frames.valid, axis=1)  # valid frames come first
    divergence = soft_dtw_divergence(
        latents[one], latents[other], length[one], length[other], gamma=frames.hyper.gamma
    )
    count = jnp.maximum(length[one] + length[other], 1)
    return frames.hyper.soft_dtw_weight * jnp.mean(divergence / count)
