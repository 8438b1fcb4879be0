"""Sizes of the boxes around a scene's bodies, as a detector would report them."""

import jax.numpy as jnp
from gril_jax.envs.planar import shapes
from gril_jax.envs.planar.robots import Robot
from jaxtyping import Array, Float, Int


def robot_size(robot: Robot, angle: Float[Array, ""]) -> Float[Array, "2"]:
    """Size of the base's box: a disc's fingers are thin, and a detector leaves them out."""
    part = robot.parts[0]
    if part.radius:
        return jnp.full(2, 2 * part.radius)
    c, s = jnp.abs(jnp.cos(angle)), jnp.abs(jnp.sin(angle))
    half = part.boxes[0].half
    return 2 * jnp.stack([c * half[0] + s * half[1], s * half[0] + c * half[1]])


def block_sizes(shape: Int[Array, "B"], angle: Float[Array, "B"]) -> Float[Array, "B 2"]:
    """Sizes of the turned blocks' boxes; 0 for a slot without a block."""
    low, high = shapes.extents(shapes.blocks(shape), angle)
    return high - low
