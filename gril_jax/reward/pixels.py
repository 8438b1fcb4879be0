"""XIRL's reward (Zakka et al., CoRL 2021): minus the distance from a picture to the mean goal.

    params = from_videos(encoder_params, videos, config)
    r = reward.latent_goal_reward(params, pixel_encoder.floats(frame), config)

The goal is the mean latent of the videos' last frames, and the scale makes the reward about -1 at
their first frames (Eq. 7). For scene graphs `gril_jax.reward.from_demos` does the same. Shapes use
B for videos, T for frames and D for the latent.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from gril_jax.encoders import resnet
from gril_jax.encoders.message_passing import Params
from gril_jax.encoders.resnet import PixelConfig
from gril_jax.types import VideoBatch

from .latent_goal import RewardParams, from_latents


@jax.jit
def embed(params: Params, videos: VideoBatch, config: PixelConfig) -> Float[Array, "B T D"]:
    """The latent of every frame of every video, padding included; one video at a time in memory.

    Raises:
      ShapeError: the frames are not of the config's size.
    """
    one = lambda frames: resnet.apply(params, resnet.floats(frames), config)  # noqa: E731
    return jax.lax.map(one, videos.frames)


@jax.jit
def from_videos(encoder_params: Params, videos: VideoBatch, config: PixelConfig) -> RewardParams:
    """The reward of a trained encoder, with goal and scale from the videos that it was trained on.

    Each must end with the task done.

    Returns:
      Reward parameters; the scale is 1 if the encoder cannot tell first from last frames.

    Raises:
      ShapeError: there is no video, or the frames are not of the config's size.
    """
    each = jnp.arange(videos.length.shape[0])

    def latents(index):
        frames = resnet.floats(videos.frames[each, index])
        return resnet.apply(encoder_params, frames, config)

    first, last = jax.lax.map(latents, jnp.stack([jnp.zeros_like(each), videos.length - 1]))
    return from_latents(encoder_params, first, last)
