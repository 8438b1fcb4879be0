"""Boxes of things in space, whether they touch, and how a camera sees them.

It stands opposite the robot, a little to the robot's right, and looks down at the table: x of the
picture is to the robot's left, y is up. Pictures are square, and their units are half a width: the
middle is 0, edges are at -1 and 1, so that a picture's half extent is 1. A box that leaves the
picture keeps its box beyond the edge.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.panda import kinematics
from gril_jax.envs.panda import model as panda_model
from gril_jax.envs.panda.kinematics import Frame, into, out_of, turned
from jaxtyping import Array, Bool, Float

HALF_EXTENT = 1.0  # of every picture, in its own units

_NEAREST = 0.05  # metres before the camera; what is nearer counts as there
_SIGNS = np.array([[(i >> k & 1) * 2.0 - 1 for k in range(3)] for i in range(8)], np.float32)
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


def robot(hand: Frame, left: Float[Array, ""], right: Float[Array, ""]) -> Boxes:
    """Boxes of left finger, right finger and hand, by the openings of the fingers, metres."""
    fingers = kinematics.finger(hand, left, 1), kinematics.finger(hand, right, -1)
    tips = [box(finger, *panda_model.TIP_BOX) for finger in fingers]
    return stacked([*tips, box(hand, *panda_model.HAND_BOX)])


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


class Camera(NamedTuple):
    """A pinhole camera that keeps the horizon level."""

    place: tuple[float, float, float]  # metres
    target: tuple[float, float, float]  # what the middle of the picture shows; not straight below
    field: float  # of view, from edge to edge, rad


CAMERA = Camera(place=(1.5, -0.05, 1.0), target=(0.45, -0.05, 0.2), field=float(np.radians(50)))


@functools.cache
def axes(camera: Camera) -> np.ndarray:
    """Rows are the picture's x and y axes and the view direction, in world axes (3, 3)."""
    forward = np.subtract(camera.target, camera.place)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(right, forward), forward]).astype(np.float32)


def _corners(camera: Camera, position, rotation, half):
    """Projected corners (..., 8, 2) of boxes; arrays of NumPy or of JAX."""
    offset = _SIGNS * half[..., None, :]
    offset = (rotation[..., None, :, :] * offset[..., None, :]).sum(-1)
    away = position[..., None, :] + offset - np.array(camera.place, np.float32)
    seen = (axes(camera) * away[..., None, :]).sum(-1)
    depth = seen[..., 2:].clip(_NEAREST) * np.float32(np.tan(camera.field / 2))
    return seen[..., :2] / depth


def project(camera: Camera, boxes: Boxes) -> tuple[Float[Array, "*N 2"], Float[Array, "*N 2"]]:
    """Centres and sizes of the boxes in the picture, over all eight corners of each.

    Nothing hides anything here: these are the boxes of whole things.
    """
    corners = _corners(camera, *boxes)
    low, high = corners.min(axis=-2), corners.max(axis=-2)
    return (low + high) / 2, high - low


def outline(camera: Camera, position: np.ndarray, rotation: np.ndarray, half: np.ndarray):
    """The corners (V, 2) of one box's silhouette in the picture, counter-clockwise (host side)."""
    corners = _corners(camera, position, rotation, half).astype(np.float64)
    points = corners[np.lexsort(corners.T[::-1])]
    return np.array([*_chain(points), *_chain(points[::-1])])


def _chain(points: np.ndarray) -> list[np.ndarray]:
    """Half of a convex hull, without its last point (Andrew's monotone chain)."""
    chain: list[np.ndarray] = []
    for point in points:
        while len(chain) > 1:
            (x, y), (u, v) = chain[-1] - chain[-2], point - chain[-1]
            if x * v - y * u > 0:  # the path turns left
                break
            chain.pop()
        chain.append(point)
    return chain[:-1]
