"""Contact capsules of the blocks and of the gripper, for the MJX engine.

MJX collides spheres and capsules in closed form, so a few of them stand for each outline of
`shapes` and `robots`: flush with it along its edges, rounded at its corners.
"""

import math
from typing import NamedTuple

import numpy as np

from . import robots, shapes

__all__ = ["FINGER_RADIUS", "Capsule", "block", "disc", "finger"]

FINGER_RADIUS = 0.025  # half a finger's thickness
_EDGE_RADIUS = 0.04  # rounds a polygon's corners by at most 0.02
_SPOKE_RADIUS = 0.04  # so that the notches between two spokes lie near the true ones


class Capsule(NamedTuple):
    """All points within `radius` of a segment; a disc if the segment's ends are one point."""

    start: tuple[float, float]
    end: tuple[float, float]
    radius: float


def _capsule(start: np.ndarray, end: np.ndarray, radius: float) -> Capsule:
    return Capsule((float(start[0]), float(start[1])), (float(end[0]), float(end[1])), radius)


def disc(radius: float) -> tuple[Capsule, ...]:
    """A disc around the origin."""
    return (Capsule((0.0, 0.0), (0.0, 0.0), radius),)


def _edges(corners: np.ndarray) -> tuple[Capsule, ...]:
    """Capsules along the edges of a regular polygon, their outer sides flush with it."""
    apothem = np.linalg.norm(corners[0]) * math.cos(math.pi / len(corners))
    inner = corners * (1 - _EDGE_RADIUS / apothem)
    pairs = zip(inner, np.roll(inner, -1, axis=0), strict=True)
    return tuple(_capsule(a, b, _EDGE_RADIUS) for a, b in pairs)


def _spokes(corners: np.ndarray) -> tuple[Capsule, ...]:
    """Capsules from a star's centre to its tips."""
    tips = corners[::2]
    ends = tips * (1 - _SPOKE_RADIUS / np.linalg.norm(tips[0]))
    return tuple(_capsule(np.zeros(2), end, _SPOKE_RADIUS) for end in ends)


def block(name: str) -> tuple[Capsule, ...]:
    """Capsules of a block, one of `shapes.SHAPES`, in its own frame (arena units)."""
    if name == "circle":
        return disc(shapes.SIZE)
    corners = shapes.outline(name)
    return _spokes(corners) if name == "star" else _edges(corners)


def finger(part: robots.Part) -> tuple[Capsule, ...]:
    """Capsules of a gripper's finger, upper arm then forearm, in its pivot's frame.

    The forearm is bent about the outer corner of the elbow, so the middle lines of both arms meet
    nearly, not quite. The elbow stands out by 0.002.
    """
    _, fore = part.boxes
    along = np.array([-math.sin(fore.angle), math.cos(fore.angle)])
    middle, half = np.array(fore.center), fore.half[1]
    elbow = middle - half * along
    upper = np.array([0.0, elbow[1]])
    wrist = middle + (half - FINGER_RADIUS) * along
    return (
        _capsule(np.zeros(2), upper, FINGER_RADIUS),
        _capsule(elbow, wrist, FINGER_RADIUS),
    )
