"""The blocks' shapes as data, so that one compiled program serves any mix of them.

All four have a symmetry that folds the plane into a single wedge: choose the direction (a face's
normal, or a star's tip) nearest to the point, and the rim in that wedge is one segment, given by
its distance along the direction and across it. A circle is a point with a radius. A slot without a
block has the shape `NOTHING`, whose radius is so far below zero that nothing ever touches it.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .plane import Vec, heading, where
from .robots import unit_inertia

SHAPES = ("star", "square", "pentagon", "circle")
NOTHING = len(SHAPES)  # in the place of an index: no block
SIZE = 0.12  # every block's area is about pi SIZE^2
_MASS = 0.01  # for which inertias are given


class BlockShape(NamedTuple):
    """Shapes of B blocks. Vectors are in the block's frame; the rim's are (along, across)."""

    directions: Vec  # (5, B) unit vectors; repeated where there are fewer
    rim_start: Vec  # (B,) the rim's segment
    rim_end: Vec  # (B,)
    rim_out: Vec  # (B,) its outward unit normal
    corners: Vec  # (5, B); repeated where there are fewer
    radius: Float[Array, "B"]  # by which rim and corners are rounded
    inverse_inertia: Float[Array, "B"]  # for a mass of 0.01


def _ring(count: int, radius: float, first: float = math.pi / 2) -> np.ndarray:
    angles = first + 2 * math.pi * np.arange(count) / count
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def _five(points: np.ndarray) -> Vec:
    return Vec(*points[np.minimum(np.arange(5), len(points) - 1)].T)


def _polygon(count: int, circumradius: float, first: float, radius: float) -> BlockShape:
    """A regular polygon; `radius` rounds its corners outwards."""
    apothem = circumradius * math.cos(math.pi / count)
    half = circumradius * math.sin(math.pi / count)
    normals = _five(_ring(count, 1.0, first + math.pi / count))
    corners = _five(_ring(count, circumradius, first))
    rim = Vec(apothem, 0.0), Vec(apothem, half), Vec(1.0, 0.0)
    inertia = _MASS * unit_inertia(_ring(count, circumradius, first))
    return BlockShape(normals, *rim, corners, radius, 1.0 / inertia)


def _star() -> BlockShape:
    tip, notch, half = 1.3 * SIZE, 0.65 * SIZE, math.pi / 5
    start, end = Vec(tip, 0.0), Vec(notch * math.cos(half), notch * math.sin(half))
    out = np.array([end.y - start.y, start.x - end.x])
    tips = _five(_ring(5, 1.0))
    out = Vec(*(out / np.linalg.norm(out)))
    inertia = _MASS * unit_inertia(_ring(5, tip))  # that of its hull
    return BlockShape(tips, start, end, out, tips * tip, 0.0, 1.0 / inertia)


_HALF_SQUARE = math.sqrt(math.pi) * SIZE / 2
_PENTAGON = SIZE * math.sqrt(2 * math.pi / (5 * math.sin(2 * math.pi / 5)))
_CIRCLE = 2 / (_MASS * SIZE**2)
_NONE = Vec(0.0, 0.0)
_TABLE = {  # of one block each
    "star": _star(),
    "square": _polygon(4, _HALF_SQUARE * math.sqrt(2), math.pi / 4, 0.02 * _HALF_SQUARE),
    "pentagon": _polygon(5, _PENTAGON, math.pi / 2, 0.0),
    "circle": BlockShape(
        _five(_ring(5, 1.0)), _NONE, _NONE, Vec(1.0, 0.0), _five(np.zeros((5, 2))), SIZE, _CIRCLE
    ),
}
_ABSENT = _TABLE["circle"]._replace(radius=-1e3)
_STACKED = jax.tree.map(
    lambda *f: np.stack(f, axis=-1).astype(np.float32), *(_TABLE[s] for s in SHAPES), _ABSENT
)


def blocks(shape: Int[Array, "B"]) -> BlockShape:
    """The shapes of blocks, given by their index in `SHAPES`, or `NOTHING`."""
    return jax.tree.map(lambda field: jnp.asarray(field)[..., shape], _STACKED)


def outline(name: str) -> np.ndarray:
    """The corners (V, 2) of a block, counter-clockwise, for painting and for its box."""
    if name == "circle":
        return _ring(32, SIZE)
    corners = np.stack([_TABLE[name].corners.x, _TABLE[name].corners.y], axis=1)
    if name == "star":
        notches = _ring(5, 0.65 * SIZE, math.pi / 2 + math.pi / 5)
        return np.stack([corners, notches], axis=1).reshape(10, 2)
    return corners[: 4 if name == "square" else 5]


def arm_distance(shape: BlockShape, point: Vec, direction: Vec) -> tuple[Array, Vec]:
    """Signed distance of points (..., B) to the blocks' rims, negative inside, and the outward unit
    normal, in the blocks' frames. The rim's part in one of `directions` counts: a star's arm."""
    across = direction.cross(point)
    side = jnp.where(across < 0, -1.0, 1.0)
    rim = shape.rim_end - shape.rim_start
    folded = Vec(direction.dot(point), across * side) - shape.rim_start
    line = shape.rim_out.dot(folded)  # beyond the segment's line
    share = jnp.clip(folded.dot(rim) / jnp.maximum(rim.dot(rim), 1e-12), 0.0, 1.0)
    gap = folded - rim * share
    far = jnp.sqrt(gap.dot(gap) + 1e-14)
    outside = line > 1e-6
    normal = where(outside, gap * (1.0 / far), shape.rim_out)
    normal = Vec(normal.x, normal.y * side).out_of(direction)
    return jnp.where(outside, far, line) - shape.radius, normal


def extents(
    shape: BlockShape, angle: Float[Array, "B"]
) -> tuple[Float[Array, "B 2"], Float[Array, "B 2"]]:
    """Lowest and highest point of blocks turned by `angle`, relative to their centres."""
    corners, radius = shape.corners.out_of(heading(angle)), jnp.maximum(shape.radius, 0.0)[:, None]
    stack = lambda x, y: jnp.stack([x, y], axis=-1)  # noqa: E731
    low = stack(corners.x.min(axis=0), corners.y.min(axis=0)) - radius
    return low, stack(corners.x.max(axis=0), corners.y.max(axis=0)) + radius
