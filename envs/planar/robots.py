"""The robots: their parts, and the shape of each part.

Forward is +y of the robot's own frame. A part's centre of mass is the origin of its frame; a
finger's is its pivot, as in the original simulator. Lengths in arena units, masses and inertias in
the original's units.
"""

import math
from typing import NamedTuple

import numpy as np

FINGER_OPEN = math.pi / 8  # rad from closed (parallel) to fully open
PIVOTS = np.array([[-0.09, 0.02], [0.09, 0.02]])  # of the fingers, left first, on the base
_ARM, _FOREARM, _THICKNESS = 0.22, 0.14, 0.05


class Box(NamedTuple):
    """A rectangle in its part's frame."""

    center: tuple[float, float]
    half: tuple[float, float]  # half width along its own x, half length along its own y
    angle: float


class Part(NamedTuple):
    """One rigid body of a robot: a disc if `radius` is positive, else boxes."""

    mass: float
    inertia: float  # about the origin of its frame
    friction: float  # Chipmunk's coefficient of this surface
    radius: float
    boxes: tuple[Box, ...]
    corners: np.ndarray  # (C, 2) corners that can touch something
    outline: np.ndarray  # (V, 2) polygon to paint and to measure


class Robot(NamedTuple):
    """A base, and two fingers if it is a gripper."""

    name: str
    parts: tuple[Part, ...]

    @property
    def has_fingers(self) -> bool:
        """True if there are fingers to open and close."""
        return len(self.parts) > 1


def _finger(side: int) -> Part:
    """A finger in its pivot's frame, closed; `side` is -1 for the left and +1 for the right.

    The forearm is the continuation of the upper arm, bent inward about the outer elbow corner.
    """
    bend = side * math.pi / 8  # counter-clockwise bends the right finger's forearm inward
    along = np.array([-math.sin(bend), math.cos(bend)])
    inward = -side * np.array([math.cos(bend), math.sin(bend)])
    elbow = np.array([side * _THICKNESS / 2, _ARM])
    middle = elbow + along * _FOREARM / 2 + inward * _THICKNESS / 2
    upper = Box((0.0, _ARM / 2), (_THICKNESS / 2, _ARM / 2), 0.0)
    fore = Box((float(middle[0]), float(middle[1])), (_THICKNESS / 2, _FOREARM / 2), bend)
    tips = [elbow + along * _FOREARM, elbow + along * _FOREARM + inward * _THICKNESS]
    inner_elbow = np.array([-side * _THICKNESS / 2, _ARM])
    # Where the inner sides of both arms meet: the forearm's inner side dips into the upper arm.
    start = elbow + inward * _THICKNESS
    crook = start + (inner_elbow[0] - start[0]) / along[0] * along
    root = _THICKNESS / 2 * np.array([[-side, 0.0], [side, 0.0]])
    outline = np.array([root[1], elbow, tips[0], tips[1], crook, root[0]])
    corners = np.array([elbow, tips[0], tips[1]])
    rims = np.concatenate([_rim(upper), _rim(fore)])
    return Part(0.125, 0.125 * unit_inertia(rims), 5.0, 0.0, (upper, fore), corners, outline)


def _rim(box: Box) -> np.ndarray:
    """Corners (4, 2) of a box in its part's frame, from the right one at its far end."""
    c, s = math.cos(box.angle), math.sin(box.angle)
    local = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * np.array(box.half)
    return local @ np.array([[c, s], [-s, c]]) + np.array(box.center)


def unit_inertia(corners: np.ndarray) -> float:
    """Moment of inertia about the origin of a polygon (V, 2) of mass 1, counter-clockwise.

    A finger's is that of the corners of both its boxes in a row, as the original computes it.
    """
    following = np.roll(corners, -1, axis=0)
    area = corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]
    squares = (corners * (corners + following) + following**2).sum(axis=1)
    return float((area * squares).sum() / (6 * area.sum()))


def _stick(name: str, width: float) -> Robot:
    box = Box((0.0, 0.0), (width / 2, 0.05), 0.0)
    inertia = (width**2 + 0.1**2) / 12
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * np.array(box.half)
    return Robot(name, (Part(1.0, inertia, 0.5, 0.0, (box,), corners, corners),))


_ANGLES = np.arange(32) * math.pi / 16
_RING = 0.2 * np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)
_BASE = Part(1.0, 0.020, 0.5, 0.2, (), np.zeros((1, 2)), _RING)
_ROBOTS = {
    "gripper": Robot("gripper", (_BASE, _finger(-1), _finger(1))),
    "short": _stick("short", 0.30),
    "medium": _stick("medium", 0.60),
    "long": _stick("long", 1.60),
}
ROBOTS = tuple(_ROBOTS)


def robot(name: str) -> Robot:
    """The robot of the given name, one of `ROBOTS`."""
    return _ROBOTS[name]
