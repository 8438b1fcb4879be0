"""Boxes of things in space: whether they touch, and what a detector would see of them.

The view is a parallel one from in front of the robot, along its -x axis: a picture's x axis is the
robot's y axis (its left is on the right), its y axis is up, and its middle is 0.4 m above the table
before the robot's foot. All of the tasks' motions lie mostly in that plane.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .tabletop_frames import Frame, into, out_of, turned

__all__ = ["HALF_EXTENT", "Boxes", "box", "free", "front_view", "lowest", "outline", "touching"]

HALF_EXTENT = 0.6  # metres: half the width of the view
_VIEW_HEIGHT = 0.4
_NEAR = 0.0015  # metres; a contact of MuJoCo's gives way by less


class Boxes(NamedTuple):
    """Boxes around N things, in the world."""

    position: Float[Array, "*N 3"]  # centres, metres
    rotation: Float[Array, "*N 3 3"]
    half: Float[Array, "*N 3"]  # half extents along their own axes, metres


def box(frame: Frame, center, half) -> Boxes:
    """A box given in a frame."""
    place = out_of(frame, jnp.broadcast_to(jnp.array(center, jnp.float32), frame.position.shape))
    extent = jnp.broadcast_to(jnp.array(half, jnp.float32), frame.position.shape)
    return Boxes(place, frame.rotation, extent)


def _reach(boxes: Boxes) -> Float[Array, "*N 3"]:
    """Half extents along the world's axes."""
    return turned(jnp.abs(boxes.rotation), boxes.half)


def lowest(boxes: Boxes) -> Float[Array, "*N"]:
    """Height of the lowest corner, metres."""
    return boxes.position[..., 2] - _reach(boxes)[..., 2]


def touching(small: Boxes, large: Boxes) -> Bool[Array, "*B"]:
    """Whether a small box touches a large one.

    The small one counts with its extents along the axes of the large one: exact where they are
    parallel, as pads on what they hold are, and never too few otherwise.
    """
    place = into(Frame(large.position, large.rotation), small.position)
    relative = jnp.sum(large.rotation[..., :, :, None] * small.rotation[..., :, None, :], axis=-3)
    reach = large.half + turned(jnp.abs(relative), small.half) + _NEAR
    return (jnp.abs(place) <= reach).all(axis=-1)


def free(pads: Boxes, thing: Boxes) -> Bool[Array, ""]:
    """Whether no pad touches the thing."""
    return ~jax.vmap(touching, in_axes=(0, None))(pads, thing).any()


def front_view(boxes: Boxes) -> tuple[Float[Array, "N 2"], Float[Array, "N 2"]]:
    """Centres, and widths and heights, of the boxes in the view."""
    middle = jnp.array([0.0, _VIEW_HEIGHT])
    return boxes.position[:, 1:] - middle, 2 * _reach(boxes)[:, 1:]


def outline(position: np.ndarray, rotation: np.ndarray, half: np.ndarray) -> np.ndarray:
    """The corners (V, 2) of one box's silhouette in the view, counter-clockwise (host side).

    A parallel view of a box is the sum of its three edges' views, so its outline has these edges,
    to and fro, in the order of their directions.
    """
    edges = 2 * (rotation * half)[1:].T  # (3, 2), in the view
    edges = np.where((edges[:, 1:] < 0) | ((edges[:, 1:] == 0) & (edges[:, :1] < 0)), -edges, edges)
    edges = edges[np.argsort(np.arctan2(edges[:, 1], edges[:, 0]))]
    steps = np.concatenate([edges, -edges])
    corners = np.cumsum(steps, axis=0) - steps
    middle = position[1:] - [0.0, _VIEW_HEIGHT]
    return corners - edges.sum(axis=0) / 2 + middle
