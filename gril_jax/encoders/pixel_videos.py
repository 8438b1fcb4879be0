"""Videos as arrays of small pictures: the training batch of pixel encoders, and its symmetries.

Shapes use B for videos, V for those of a batch, T and F for frames and P for the side of a frame.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, PRNGKeyArray, UInt8


class VideoBatch(NamedTuple):
    """Videos of square frames, padded to a common length with their last frame."""

    frames: UInt8[Array, "B T P P 3"]  # RGB; x to the right, y upwards
    length: Int[Array, "B"]  # frames before padding, at least 1


def turn(key: PRNGKeyArray, frames: UInt8[Array, "V F P P 3"]) -> UInt8[Array, "V F P P 3"]:
    """Applies a random symmetry of the square to each video, the same to all of its frames.

    The same symmetries as `gril_jax.pretraining.batch.turn` draws for boxes from the same key. The
    key is consumed.
    """
    sign_key, swap_key = jax.random.split(key)
    num = frames.shape[0]
    sign = jax.random.rademacher(sign_key, (num, 1, 1, 2), dtype=jnp.float32)[..., None, None]
    swap = jax.random.bernoulli(swap_key, shape=(num, 1, 1, 1))[..., None]
    # x and y swapped: mirrored at the diagonal that rises to the right.
    frames = jnp.where(swap, frames.swapaxes(2, 3)[:, :, ::-1, ::-1], frames)
    frames = jnp.where(sign[:, :, :, 0] < 0, frames[:, :, :, ::-1], frames)
    return jnp.where(sign[:, :, :, 1] < 0, frames[:, :, ::-1], frames)
