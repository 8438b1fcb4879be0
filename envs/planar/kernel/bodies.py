"""Bodies in the kernel: vectors of the plane, a robot's parts, and distances to blocks.

The distances are those of `planar.shapes`. Warp's functions and structures are marked by
`no_type_check`, the name by which jaxtyping's import hook knows what it must leave as it is.
"""

import typing

import numpy as np
import warp as wp
from gril_jax.envs.planar.robots import Part as RobotPart

Floats = wp.array(dtype=float)
Vec2s, Vec3s = wp.array(dtype=wp.vec2), wp.array(dtype=wp.vec3)


def no_type_check(made: typing.Any) -> typing.Any:
    """A Warp function, or of a class a structure. By this name jaxtyping's import hook knows what
    it must leave as it is."""
    kind = wp.struct if isinstance(made, type) else wp.func
    return kind(typing.no_type_check(made))


INSIDE = 1e-6  # beyond this a point is outside


@no_type_check
class Part:
    """One rigid body of the robot; see `robots.Part`. Of boxes and corners some may be unused."""

    weight: wp.vec2  # inverse mass, inverse inertia
    friction: float
    radius: float
    reach: float  # radius of the circle around all of it
    boxes: int
    upper: wp.vec4  # centre and half size of the first box, which is not tilted
    fore: wp.vec4  # of the second
    tilt: wp.vec2  # cosine and sine of the second
    corners: int
    ends: wp.types.vector(8, float)  # x, y of each corner


@no_type_check
class Shapes:
    """The fields of `shapes.BlockShape` for B blocks."""

    directions: wp.array2d(dtype=wp.vec2)  # (B, 5)
    corners: wp.array2d(dtype=wp.vec2)  # (B, 5)
    rims: wp.array2d(dtype=wp.vec2)  # (B, 3): start, end, outward normal
    sizes: wp.array2d(dtype=float)  # (B, 3): radius, inverse inertia, radius of the circle around


@no_type_check
def cross(a: wp.vec2, b: wp.vec2) -> float:
    """The z component of the vector product."""
    return a[0] * b[1] - a[1] * b[0]


@no_type_check
def turned(a: wp.vec2) -> wp.vec2:
    """Rotates by a quarter turn counter-clockwise."""
    return wp.vec2(-a[1], a[0])


@no_type_check
def out_of(a: wp.vec2, frame: wp.vec2) -> wp.vec2:
    """Rotates from a frame turned by (cosine, sine) into the world's."""
    return wp.vec2(frame[0] * a[0] - frame[1] * a[1], frame[1] * a[0] + frame[0] * a[1])


@no_type_check
def into(a: wp.vec2, frame: wp.vec2) -> wp.vec2:
    """Rotates from the world's frame into one turned by (cosine, sine)."""
    return wp.vec2(frame[0] * a[0] + frame[1] * a[1], frame[0] * a[1] - frame[1] * a[0])


@no_type_check
def sign(x: float) -> float:
    """-1 below zero, else 1."""
    return wp.where(x < 0.0, -1.0, 1.0)


@no_type_check
def arm_distance(shapes: Shapes, b: int, arm: int, point: wp.vec2, margin: float):
    """Signed distance of a point in block b's frame, and the outward normal, in that frame.

    It is that to the rim in one of the directions, a star's arm. Beyond the margin a distance is
    only some number that is beyond it, too.
    """
    direction = shapes.directions[b, arm]
    start, end, out = shapes.rims[b, 0], shapes.rims[b, 1], shapes.rims[b, 2]
    across = cross(direction, point)
    side = sign(across)
    folded = wp.vec2(wp.dot(direction, point), across * side) - start
    distance = wp.dot(out, folded)
    normal = out
    if distance > INSIDE and distance <= margin + shapes.sizes[b, 0]:
        rim = end - start
        share = wp.dot(folded, rim) / wp.max(wp.dot(rim, rim), 1.0e-12)
        gap = folded - rim * wp.clamp(share, 0.0, 1.0)
        distance = wp.sqrt(wp.dot(gap, gap) + 1.0e-14)
        normal = gap * (1.0 / distance)
    normal = out_of(wp.vec2(normal[0], normal[1] * side), direction)
    return distance - shapes.sizes[b, 0], normal


_CORNERS = 4
Numbers = wp.types.vector(17 + 2 * _CORNERS, wp.float32)


def numbers(parts: tuple[RobotPart, ...]):
    """A Warp matrix whose rows are the parts, their numbers in the order of `part_of`."""
    rows = np.array([_numbers_of(part) for part in parts])
    return wp.types.matrix(rows.shape, wp.float32)(rows)


def _numbers_of(part: RobotPart) -> np.ndarray:
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


@no_type_check
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
