"""Outlines and contact shapes of the blocks and robots of the planar tasks.

An object's frame has its centre of mass at the origin and its first vertex, or its front, on +y.
Lengths are in arena units. Sizes follow MAGICAL's MatchRegions; contacts use a few capsules a
block because MJX collides those in closed form.
"""

import math
from typing import NamedTuple

import numpy as np

__all__ = ["BLOCK_SHAPES", "FINGER_RADIUS", "Capsule", "Shape", "block", "finger", "stadium"]

_S = 0.12  # the "size" of a block: every block's area is about pi S^2


class Capsule(NamedTuple):
    """A contact primitive: all points within `radius` of a segment."""

    start: tuple[float, float]
    end: tuple[float, float]
    radius: float


class Shape(NamedTuple):
    """One rigid planar outline."""

    vertices: np.ndarray  # (V, 2) outline; the axis-aligned box is exact for these
    capsules: tuple[Capsule, ...]
    inertia: float  # about the centre of mass, for the mass that the reference gives it


def _ring(count: int, radius: float, first: float = math.pi / 2) -> np.ndarray:
    angles = first + 2 * math.pi * np.arange(count) / count
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def _edges(vertices: np.ndarray, radius: float) -> tuple[Capsule, ...]:
    """Capsules along the edges of a regular polygon, their outer sides flush with it."""
    circumradius = np.linalg.norm(vertices[0])
    apothem = circumradius * math.cos(math.pi / len(vertices))
    inner = vertices * (apothem - radius) / apothem
    return tuple(
        Capsule(tuple(a), tuple(b), radius)
        for a, b in zip(inner, np.roll(inner, -1, axis=0), strict=True)
    )


def _star() -> Shape:
    outer, inner = 1.3 * _S, 0.65 * _S
    tips, notches = _ring(5, outer), _ring(5, inner, math.pi / 2 + math.pi / 5)
    vertices = np.stack([tips, notches], axis=1).reshape(10, 2)
    radius = 0.04  # so that the notches between two spokes lie near the true ones
    spokes = tuple(Capsule((0.0, 0.0), tuple(t * (outer - radius) / outer), radius) for t in tips)
    return Shape(vertices, spokes, 9.365e-5)


def _square() -> Shape:
    half = math.sqrt(math.pi) * _S / 2
    vertices = half * np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    return Shape(vertices, _edges(vertices, 0.04), 7.540e-5)


def _pentagon() -> Shape:
    vertices = _ring(5, 0.1379)
    return Shape(vertices, _edges(vertices, 0.04), 7.322e-5)


def _circle() -> Shape:
    return Shape(_ring(32, _S), (Capsule((0.0, 0.0), (0.0, 0.0), _S),), 7.2e-5)


_BLOCKS = {"star": _star, "square": _square, "pentagon": _pentagon, "circle": _circle}
BLOCK_SHAPES = tuple(_BLOCKS)


def block(name: str) -> Shape:
    """The outline and contact shape of a block ("star", "square", "pentagon" or "circle")."""
    return _BLOCKS[name]()


def stadium(width: float, depth: float, inertia: float) -> Shape:
    """A bar across the direction of travel: the stick robots."""
    x, y = width / 2, depth / 2
    vertices = np.array([[x, y], [-x, y], [-x, -y], [x, -y]])
    return Shape(vertices, (Capsule((-(x - y), 0.0), (x - y, 0.0), y),), inertia)


FINGER_RADIUS = 0.025


def finger(side: int) -> Shape:
    """One finger in its pivot's frame, closed; `side` is -1 for the left and +1 for the right.

    An upper arm along +y and a forearm bent inward by pi/8. `inertia` is about the pivot.
    """
    bend = math.pi / 8
    elbow = np.array([0.0, 0.22])
    along = np.array([-side * math.sin(bend), math.cos(bend)])
    tip = elbow + 0.14 * along
    across = FINGER_RADIUS * np.array([along[1], -along[0]])
    r = FINGER_RADIUS
    side_step = np.array([r, 0.0])
    right = [side_step, elbow + side_step, tip + across]
    left = [tip - across, elbow - side_step, -side_step]
    vertices = np.array(right + left)
    wrist = tuple(tip - FINGER_RADIUS * along)
    arms = (
        Capsule((0.0, 0.0), tuple(elbow), FINGER_RADIUS),
        Capsule(tuple(elbow), wrist, FINGER_RADIUS),
    )
    return Shape(vertices, arms, 0.005)
