"""Boxes of things in space, and whether they touch. A camera's view is in `camera`."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from gril_jax.envs.panda.frames import Frame, into, out_of, turned
from jaxtyping import Array, Bool, Float

_NEAR = 0.0015  # metres; a contact of MuJoCo's gives way by less


class Boxes(NamedTuple):
    """Oriented boxes around N objects, in the world."""

    position: Float[Array, "*N 3"]  # centres, metres
    rotation: Float[Array, "*N 3 3"]
    half: Float[Array, "*N 3"]  # half extents along their own axes, metres


def box(frame: Frame, center, half) -> Boxes:
    """A box given in a frame."""
    place = out_of(frame, jnp.broadcast_to(jnp.array(center, jnp.float32), frame.position.shape))
    extent = jnp.broadcast_to(jnp.array(half, jnp.float32), frame.position.shape)
    return Boxes(place, frame.rotation, extent)


def stacked(boxes: list[Boxes]) -> Boxes:
    """Several boxes as one."""
    return jax.tree.map(lambda *x: jnp.stack(x), *boxes)


def lowest(boxes: Boxes) -> Float[Array, "*N"]:
    """Height of the lowest corner, metres."""
    return boxes.position[..., 2] - turned(jnp.abs(boxes.rotation), boxes.half)[..., 2]


def touching(small: Boxes, large: Boxes) -> Bool[Array, "*B"]:
    """True if a small box touches a large one.

    The small one counts with its extents along the axes of the large one: exact where they are
    parallel, as pads on what they hold are, and never too few otherwise.
    """
    place = into(Frame(large.position, large.rotation), small.position)
    relative = jnp.sum(large.rotation[..., :, :, None] * small.rotation[..., :, None, :], axis=-3)
    reach = large.half + turned(jnp.abs(relative), small.half) + _NEAR
    return (jnp.abs(place) <= reach).all(axis=-1)


def free(pads: Boxes, thing: Boxes) -> Bool[Array, ""]:
    """True if no pad touches the thing."""
    return ~jax.vmap(touching, in_axes=(0, None))(pads, thing).any()
