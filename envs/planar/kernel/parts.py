"""A robot's parts as numbers that the kernel has as constants."""

import numpy as np
import warp as wp
from gril_jax.envs.planar.robots import Part as RobotPart

from . import device
from .outlines import Part

_CORNERS = 4
Numbers = wp.types.vector(17 + 2 * _CORNERS, wp.float32)


def numbers(parts: tuple[RobotPart, ...]):
    """A Warp matrix whose rows are the parts, their numbers in the order of `part_of`."""
    rows = np.array([_of(part) for part in parts])
    return wp.types.matrix(rows.shape, wp.float32)(rows)


def _of(part: RobotPart) -> np.ndarray:
    boxes = [(*b.center, *b.half) for b in part.boxes]
    tilt = part.boxes[-1].angle if boxes else 0.0
    boxes += [(0.0,) * 4] * (2 - len(boxes))
    reach = part.radius or np.linalg.norm(part.outline, axis=1).max()
    ends = np.zeros((_CORNERS, 2))
    ends[: len(part.corners)] = part.corners
    return np.array([
        1 / part.mass, 1 / part.inertia, part.friction, part.radius, reach, len(part.boxes),
        *boxes[0], *boxes[1], np.cos(tilt), np.sin(tilt), len(part.corners), *ends.ravel(),
    ])  # fmt: skip


@device.no_type_check
def part_of(x: Numbers) -> Part:
    """A part from its numbers."""
    part = Part()
    part.weight = wp.vec2(x[0], x[1])
    part.friction = x[2]
    part.radius = x[3]
    part.reach = x[4]
    part.boxes = int(x[5])
    part.upper = wp.vec4(x[6], x[7], x[8], x[9])
    part.fore = wp.vec4(x[10], x[11], x[12], x[13])
    part.tilt = wp.vec2(x[14], x[15])
    part.corners = int(x[16])
    for k in range(2 * _CORNERS):
        part.ends[k] = x[17 + k]
    return part
