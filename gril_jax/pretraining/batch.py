"""Training batches of an encoder: choice of videos and frames, and their augmentation.

Shapes use B for demonstrations, V for the videos of a batch, F for the frames drawn from each.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from gril_jax.types import DemoBatch

from .options import PixelStatic


def draw(
    key: PRNGKeyArray, length: Int[Array, "B"], num_frames: int, config: PixelStatic
) -> tuple[Int[Array, "V F"], Bool[Array, "V F"], Int[Array, "V"]]:
    """Samples distinct videos, and distinct frames of each in order of time.

    A video shorter than the number of frames gives all it has; the rest is not valid.
    """
    video_key, frame_key = jax.random.split(key)
    videos = jax.random.choice(video_key, len(length), (config.num_videos,), replace=False)
    limit = length[videos, None]
    noise = jax.random.uniform(frame_key, (config.num_videos, num_frames))
    noise = jnp.where(jnp.arange(num_frames) < limit, noise, -1.0)  # padding is drawn last
    _, frames = jax.lax.top_k(noise, min(config.num_frames, num_frames))
    frames = jnp.sort(frames, axis=-1)
    return frames, frames < limit, videos


def turn(key: PRNGKeyArray, demos: DemoBatch) -> DemoBatch:
    """Applies a random symmetry of the square to each video; activity bits do not change."""
    sign_key, swap_key = jax.random.split(key)
    num = demos.length.shape[0]
    sign = jax.random.rademacher(sign_key, (num, 1, 1, 2), dtype=jnp.float32)
    swap = jax.random.bernoulli(swap_key, shape=(num, 1, 1, 1))
    center, size = (jnp.where(swap, x[..., ::-1], x) for x in (demos.center, demos.size))
    return demos._replace(center=center * sign, size=size)


def touch(
    key: PRNGKeyArray, active: Bool[Array, "V T N"], probability: Float[Array, ""] | float
) -> Bool[Array, "V T N"]:
    """Sets the activity bits of some objects from the first frame to the last."""
    some = jax.random.bernoulli(key, probability, active[:, 0].shape)
    return active | some[:, None]
