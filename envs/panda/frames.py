"""Positions and rotations in space, as small pure functions.

Rotations are matrices whose columns are the turned axes; quaternions are (w, x, y, z) and of length
one. Products are sums of elementwise products: a matrix product of a graphics processor may round
its factors to ten bits.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float


class Frame(NamedTuple):
    """A place and a rotation in the world."""

    position: Float[Array, "*B 3"]  # metres
    rotation: Float[Array, "*B 3 3"]


def turned(matrix: Float[Array, "*B 3 3"], vector: Float[Array, "*B 3"]) -> Float[Array, "*B 3"]:
    """Rotates a vector given in a frame to the world's axes."""
    return jnp.sum(matrix * vector[..., None, :], axis=-1)


def compose(a: Float[Array, "*B 3 3"], b: Float[Array, "*B 3 3"]) -> Float[Array, "*B 3 3"]:
    """The rotation `b` within the rotation `a`: the product a b."""
    return jnp.sum(a[..., :, :, None] * b[..., None, :, :], axis=-2)


def out_of(frame: Frame, point: Float[Array, "*B 3"]) -> Float[Array, "*B 3"]:
    """Maps a point given in a frame to the world."""
    return frame.position + turned(frame.rotation, point)


def into(frame: Frame, point: Float[Array, "*B 3"]) -> Float[Array, "*B 3"]:
    """Maps a point of the world into a frame."""
    away = point - frame.position
    return jnp.sum(frame.rotation * away[..., :, None], axis=-2)


def rotation(quaternion: Float[Array, "*B 4"]) -> Float[Array, "*B 3 3"]:
    """The rotation matrix of a unit quaternion."""
    w, x, y, z = jnp.moveaxis(quaternion, -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)


def about_z(angle: Float[Array, "*B"]) -> Float[Array, "*B 3 3"]:
    """A rotation about the vertical, rad."""
    return rotation(quaternion_about_z(angle))


def quaternion_about_z(angle: Float[Array, "*B"]) -> Float[Array, "*B 4"]:
    """A rotation about the vertical, as a quaternion."""
    zero = jnp.zeros_like(angle)
    return jnp.stack([jnp.cos(angle / 2), zero, zero, jnp.sin(angle / 2)], axis=-1)


def small_turn(start: Float[Array, "*B 3 3"], goal: Float[Array, "*B 3 3"]) -> Float[Array, "*B 3"]:
    """The turn from `start` to `goal`: axis times the sine of the angle, world axes.

    It is the mean of the cross products of corresponding axes, and exact to second order.
    """
    return 0.5 * jnp.sum(jnp.cross(start, goal, axis=-2), axis=-1)
