"""Bodies in the kernel, and signed distances to blocks as in `planar.shapes`."""

import warp as wp

from . import device

INSIDE = 1e-6  # beyond this a point is outside


@device.no_type_check
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


@device.no_type_check
class Shapes:
    """The fields of `shapes.BlockShape` for B blocks."""

    directions: wp.array2d(dtype=wp.vec2)  # (B, 5)
    corners: wp.array2d(dtype=wp.vec2)  # (B, 5)
    rims: wp.array2d(dtype=wp.vec2)  # (B, 3): start, end, outward normal
    sizes: wp.array2d(dtype=float)  # (B, 3): radius, inverse inertia, radius of the circle around


@device.no_type_check
def cross(a: wp.vec2, b: wp.vec2) -> float:
    """The z component of the vector product."""
    return a[0] * b[1] - a[1] * b[0]


@device.no_type_check
def turned(a: wp.vec2) -> wp.vec2:
    """Rotates by a quarter turn counter-clockwise."""
    return wp.vec2(-a[1], a[0])


@device.no_type_check
def out_of(a: wp.vec2, frame: wp.vec2) -> wp.vec2:
    """Rotates from a frame turned by (cosine, sine) into the world's."""
    return wp.vec2(frame[0] * a[0] - frame[1] * a[1], frame[1] * a[0] + frame[0] * a[1])


@device.no_type_check
def into(a: wp.vec2, frame: wp.vec2) -> wp.vec2:
    """Rotates from the world's frame into one turned by (cosine, sine)."""
    return wp.vec2(frame[0] * a[0] + frame[1] * a[1], frame[0] * a[1] - frame[1] * a[0])


@device.no_type_check
def sign(x: float) -> float:
    """-1 below zero, else 1."""
    return wp.where(x < 0.0, -1.0, 1.0)


@device.no_type_check
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
