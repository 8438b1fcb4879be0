"""Contact capsules of the blocks and of the gripper, for the MJX engine.

MJX collides spheres and capsules in closed form, so a few of them stand for each outline of
`shapes` and `robots`: flush with it along its edges, rounded at its corners.
"""

import math
from typing import NamedTuple

import numpy as np

from . import robots, shapes

FINGER_RADIUS = 0.025  # half a finger's thickness
_RADIUS = 0.04  # rounds a polygon's corners by at most 0.02; a star's notches are near the true


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


def block(name: str) -> tuple[Capsule, ...]:
    """Capsules of a block, one of `shapes.SHAPES`, in its own frame (arena units)."""
    if name == "circle":
        return disc(shapes.SIZE)
    corners = shapes.outline(name)
    size = np.linalg.norm(corners[0])
    if name == "star":  # from its centre to its tips
        ends = corners[::2] * (1 - _RADIUS / size)
        return tuple(_capsule(np.zeros(2), end, _RADIUS) for end in ends)
    # Along the edges, their outer sides flush with them.
    inner = corners * (1 - _RADIUS / (size * math.cos(math.pi / len(corners))))
    pairs = zip(inner, np.roll(inner, -1, axis=0), strict=True)
    return tuple(_capsule(a, b, _RADIUS) for a, b in pairs)


def finger(part: robots.Part) -> tuple[Capsule, ...]:
    """Capsules of a gripper's finger, upper arm then forearm, in its pivot's frame.

    The forearm is bent about the outer corner of the elbow, so the middle lines of both arms meet
    nearly, not quite. The elbow stands out by 0.002.
    """
    _, fore = part.boxes
    along = np.array([-math.sin(fore.angle), math.cos(fore.angle)])
    middle, half = np.array(fore.center), fore.half[1]
    elbow = middle - half * along
    wrist = middle + (half - FINGER_RADIUS) * along
    upper = _capsule(np.zeros(2), np.array([0.0, elbow[1]]), FINGER_RADIUS)
    return upper, _capsule(elbow, wrist, FINGER_RADIUS)
