"""A scene of MAGICAL's from above: outlines and colours, in the order they are painted.

Colours are those of MAGICAL and x-magical, so that their videos and ours pass the same detector.
"""

from typing import NamedTuple

import numpy as np
from gril_jax.envs.base import Outline
from gril_jax.envs.planar import shapes
from gril_jax.envs.planar.robots import Robot

BACKGROUND = (231, 231, 234)  # outside the arena
FLOOR, GREY, GREY_RIM = (255, 255, 255), (162, 163, 175), (144, 145, 159)
_SHADES = {  # of a block, of the line around it, and of the region: half as saturated
    "green": ((195, 208, 130), (183, 198, 105), (224, 231, 191)),
    "blue": ((135, 185, 211), (110, 170, 202), (195, 220, 233)),
    "yellow": ((254, 213, 123), (254, 201, 86), (254, 234, 189)),
    "red": ((245, 129, 165), (243, 94, 141), (250, 192, 210)),
}
FILL, RIM, GOAL_FILL = ({c: shades[k] for c, shades in _SHADES.items()} for k in range(3))
BODY_WIDTH = 1  # of the line around a body, in pixels of a 384-pixel picture
ORIGINAL_GOAL_FILL = {  # MAGICAL's, a little off x-magical's
    "green": (224, 231, 191), "blue": (194, 219, 233), "yellow": (254, 234, 188),
    "red": (250, 190, 209),
}  # fmt: skip
ROBOT_RADIUS = 0.2
EYE, EYE_RADIUS, PUPIL_RADIUS = (0.08, 0.06), 0.04, 0.024  # the right eye, in the robot's frame
EYE_FILL, PUPIL_FILL = (255, 255, 255), (26, 26, 26)


class Look(NamedTuple):
    """The look of floor and regions; lengths in pixels of a 384-pixel picture."""

    floor_width: int
    goal_width: int
    goal_dash: int
    goal_fill: dict[str, tuple[int, int, int]]


X_MAGICAL, ORIGINAL = Look(2, 4, 10, GOAL_FILL), Look(1, 2, 8, ORIGINAL_GOAL_FILL)


def _placed(vertices: np.ndarray, pose: np.ndarray) -> np.ndarray:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return vertices @ np.array([[c, s], [-s, c]]) + pose[:2]


def _box(center: np.ndarray, size: np.ndarray) -> np.ndarray:
    return center + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * np.asarray(size) / 2


def _disc(center: np.ndarray, radius: float) -> np.ndarray:
    a = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    return center + radius * np.stack([np.cos(a), np.sin(a)], axis=1)


def outlines(
    robot: Robot,
    blocks: list[tuple[str, str]],
    arena: float,
    pose: np.ndarray,
    regions: list[tuple[str, np.ndarray]],
    *,
    look: Look = X_MAGICAL,
    robot_first: bool = False,
) -> list[Outline]:
    """Outlines from the blocks' (colour, shape), all poses (E, 3), and the regions' colours and
    boxes (centre, size); blocks are painted before the robot, or after it if it is the first."""
    floor = _box(np.zeros(2), np.full(2, 2 * arena))
    ground = [Outline(floor, FLOOR, GREY, width=look.floor_width)]
    line = dict(width=look.goal_width, dash=look.goal_dash)
    for colour, place in regions:
        box = _box(place[:2], place[2:])
        ground.append(Outline(box, look.goal_fill[colour], FILL[colour], **line))
    parts, painted = len(robot.parts), []
    for (colour, shape), place in zip(blocks, pose[parts:], strict=True):
        vertices = _placed(shapes.outline(shape), place)
        painted.append(Outline(vertices, FILL[colour], RIM[colour], width=BODY_WIDTH))
    machine = _robot(robot, pose[:parts])
    return ground + (machine + painted if robot_first else painted + machine)


def _robot(robot: Robot, pose: np.ndarray) -> list[Outline]:
    painted = []
    for part, place in zip(robot.parts[1:], pose[1:], strict=True):
        vertices = _placed(part.outline, place)
        painted.append(Outline(vertices, BACKGROUND, GREY, width=BODY_WIDTH))
    base = robot.parts[0]
    body = _disc(pose[0, :2], base.radius) if base.radius else _placed(base.outline, pose[0])
    painted.append(Outline(body, GREY, GREY_RIM, width=BODY_WIDTH))
    if base.radius:
        for side in (-1, 1):
            eye = _placed(np.array([side * EYE[0], EYE[1]]), pose[0])
            painted.append(Outline(_disc(eye, EYE_RADIUS), EYE_FILL, None))
            painted.append(Outline(_disc(eye, PUPIL_RADIUS), PUPIL_FILL, None))
    return painted
