"""What MatchRegions looks like from above: outlines and colours, in the order they are painted.

Colours are those of MAGICAL and x-magical, so that their videos and ours pass the same detector.
"""

import numpy as np

from . import planar_model, shapes
from .base import Outline

__all__ = ["BACKGROUND", "outlines"]

BACKGROUND = (231, 231, 234)  # outside the arena
FLOOR, GREY, GREY_RIM = (255, 255, 255), (162, 163, 175), (144, 145, 159)
FILL = {
    "green": (195, 208, 130),
    "blue": (135, 185, 211),
    "yellow": (254, 213, 123),
    "red": (245, 129, 165),
}
RIM = {
    "green": (183, 198, 105),
    "blue": (110, 170, 202),
    "yellow": (254, 201, 86),
    "red": (243, 94, 141),
}
GOAL_FILL = {  # half as saturated as the blocks
    "green": (224, 231, 191),
    "blue": (195, 220, 233),
    "yellow": (254, 234, 189),
    "red": (250, 192, 210),
}
FLOOR_WIDTH, GOAL_WIDTH, GOAL_DASH, BODY_WIDTH = 2, 4, 10, 1  # pixels of a 384-pixel picture
ROBOT_RADIUS = 0.2
EYE, EYE_RADIUS, PUPIL_RADIUS = (0.08, 0.06), 0.04, 0.024  # the right eye, in the robot's frame
EYE_FILL, PUPIL_FILL = (255, 255, 255), (26, 26, 26)


def _turn(vertices: np.ndarray, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return vertices @ np.array([[c, s], [-s, c]])


def _box(center: np.ndarray, size: np.ndarray) -> np.ndarray:
    return center + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.asarray(size) / 2


def _disc(center: np.ndarray, radius: float) -> np.ndarray:
    a = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    return center + radius * np.stack([np.cos(a), np.sin(a)], axis=1)


def outlines(blocks: tuple[str, ...], arena: float, qpos: np.ndarray, goal: np.ndarray):
    """One moment as a list of `Outline`, from joint positions (Q,) and the region (4,)."""
    floor = _box(np.zeros(2), np.full(2, 2 * arena))
    region = _box(goal[:2], goal[2:])
    colour = blocks[0].split()[0]
    painted = [
        Outline(floor, FLOOR, GREY, width=FLOOR_WIDTH),
        Outline(region, GOAL_FILL[colour], FILL[colour], width=GOAL_WIDTH, dash=GOAL_DASH),
    ]
    for name, (x, y, angle) in zip(blocks, qpos[5:].reshape(-1, 3), strict=True):
        colour, kind = name.split()
        vertices = _turn(shapes.block(kind).vertices, angle) + np.array([x, y])
        painted.append(Outline(vertices, FILL[colour], RIM[colour], width=BODY_WIDTH))
    return painted + _robot(qpos[:2], qpos[2], qpos[3:5])


def _robot(center: np.ndarray, yaw: float, fingers: np.ndarray) -> list[Outline]:
    parts = []
    for side, angle in zip((-1, 1), fingers, strict=True):
        pivot = np.array([side * planar_model.PIVOT[0], planar_model.PIVOT[1]])
        vertices = _turn(shapes.finger(side).vertices, angle) + pivot
        parts.append(Outline(_turn(vertices, yaw) + center, BACKGROUND, GREY, BODY_WIDTH))
    parts.append(Outline(_disc(center, ROBOT_RADIUS), GREY, GREY_RIM, BODY_WIDTH))
    for side in (-1, 1):
        eye = _turn(np.array([side * EYE[0], EYE[1]]), yaw) + center
        parts.append(Outline(_disc(eye, EYE_RADIUS), EYE_FILL, None))
        parts.append(Outline(_disc(eye, PUPIL_RADIUS), PUPIL_FILL, None))
    return parts
