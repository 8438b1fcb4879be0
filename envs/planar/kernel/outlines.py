"""Signed distances to blocks and boxes in the kernel, as `planar.shapes` and `planar.contacts`."""

from typing import no_type_check

import warp as wp

INSIDE = 1e-6  # beyond this a point is outside


@wp.struct
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


@wp.struct
@no_type_check
class Shapes:
    """The fields of `shapes.BlockShape` for B blocks."""

    directions: wp.array2d(dtype=wp.vec2)  # (B, 5)
    corners: wp.array2d(dtype=wp.vec2)  # (B, 5)
    rims: wp.array2d(dtype=wp.vec2)  # (B, 3): start, end, outward normal
    sizes: wp.array2d(dtype=float)  # (B, 3): radius, inverse inertia, radius of the circle around


@wp.func
@no_type_check
def cross(a: wp.vec2, b: wp.vec2) -> float:
    """The z component of the vector product."""
    return a[0] * b[1] - a[1] * b[0]


@wp.func
@no_type_check
def turned(a: wp.vec2) -> wp.vec2:
    """Rotates by a quarter turn counter-clockwise."""
    return wp.vec2(-a[1], a[0])


@wp.func
@no_type_check
def out_of(a: wp.vec2, frame: wp.vec2) -> wp.vec2:
    """Rotates from a frame turned by (cosine, sine) into the world's."""
    return wp.vec2(frame[0] * a[0] - frame[1] * a[1], frame[1] * a[0] + frame[0] * a[1])


@wp.func
@no_type_check
def into(a: wp.vec2, frame: wp.vec2) -> wp.vec2:
    """Rotates from the world's frame into one turned by (cosine, sine)."""
    return wp.vec2(frame[0] * a[0] + frame[1] * a[1], frame[0] * a[1] - frame[1] * a[0])


@wp.func
@no_type_check
def sign(x: float) -> float:
    """-1 below zero, else 1."""
    return wp.where(x < 0.0, -1.0, 1.0)


@wp.func
@no_type_check
def _face(shapes: Shapes, b: int, point: wp.vec2, middle: wp.vec2) -> wp.vec2:
    """The direction in which both points lie the furthest."""
    best = wp.float32(-1.0e9)
    face = wp.vec2(0.0, 0.0)
    for k in range(5):
        direction = shapes.directions[b, k]
        both = wp.min(wp.dot(direction, point), wp.dot(direction, middle))
        if both > best:
            best = both
            face = direction
    return face


@wp.func
@no_type_check
def block_distance(
    shapes: Shapes, b: int, point: wp.vec2, middle: wp.vec2, deep: bool, margin: float
):
    """Signed distance of a point in block b's frame, and the outward normal, in that frame.

    Where it can be `deep` in the block, its body's middle says through which face it leaves. Beyond
    the margin a distance is only some number that is beyond it, too.
    """
    along = wp.float32(-1.0e9)
    nearest = wp.vec2(0.0, 0.0)
    for k in range(5):
        direction = shapes.directions[b, k]
        dot = wp.dot(direction, point)
        if dot > along:
            along = dot
            nearest = direction
    start, end, out = shapes.rims[b, 0], shapes.rims[b, 1], shapes.rims[b, 2]
    across = cross(nearest, point)
    side = sign(across)
    if deep:
        if out[1] == 0.0 and end[1] > 0.0:  # a polygon
            if along < start[0]:
                nearest = _face(shapes, b, point, middle)
                along = wp.dot(nearest, point)
                across = cross(nearest, point)
                side = sign(across)
        elif wp.dot(out, wp.vec2(along, wp.abs(across)) - start) < 0.0:
            side = sign(cross(nearest, middle))
    folded = wp.vec2(along, across * side) - start
    distance = wp.dot(out, folded)
    normal = out
    if distance > INSIDE and distance <= margin + shapes.sizes[b, 0]:
        rim = end - start
        share = wp.dot(folded, rim) / wp.max(wp.dot(rim, rim), 1.0e-12)
        gap = folded - rim * wp.clamp(share, 0.0, 1.0)
        distance = wp.sqrt(wp.dot(gap, gap) + 1.0e-14)
        normal = gap * (1.0 / distance)
    normal = out_of(wp.vec2(normal[0], normal[1] * side), nearest)
    return distance - shapes.sizes[b, 0], normal


@wp.func
@no_type_check
def box_distance(box: wp.vec4, tilt: wp.vec2, point: wp.vec2, middle: wp.vec2):
    """Signed distance of a block's corner to a box, and the outward normal, in the part's frame.

    `middle` is the block's: it says through which face a corner inside leaves.
    """
    center = wp.vec2(box[0], box[1])
    local, inner = into(point - center, tilt), into(middle - center, tilt)
    dx, dy = wp.abs(local[0]) - box[2], wp.abs(local[1]) - box[3]
    corner = wp.vec2(wp.max(dx, 0.0), wp.max(dy, 0.0))
    distance = wp.sqrt(wp.dot(corner, corner) + 1.0e-14)
    if distance > INSIDE:
        edge = wp.vec2(corner[0] * sign(local[0]), corner[1] * sign(local[1]))
        return distance, out_of(edge * (1.0 / distance), tilt)
    side_x, side_y = sign(inner[0]), sign(inner[1])
    in_x, in_y = local[0] * side_x - box[2], local[1] * side_y - box[3]
    if wp.min(in_x, wp.abs(inner[0]) - box[2]) > wp.min(in_y, wp.abs(inner[1]) - box[3]):
        return in_x, out_of(wp.vec2(side_x, 0.0), tilt)
    return in_y, out_of(wp.vec2(0.0, side_y), tilt)
