"""Contacts of convex polygons and circles in the kernel, as in `planar.polygons`."""

import warp as wp

from . import bodies
from .bodies import Shapes, cross, into, out_of, turned

FAR = wp.constant(1.0e3)
NARROW = wp.constant(1.0e-9)
_LEAST = 1.0e9
Sides = wp.types.matrix((5, 2), wp.float32)


@bodies.no_type_check
class Polygon:
    """One of `polygons.Polygon`: corners, and the normals of the sides from them to the next."""

    count: int  # one is a circle's centre
    corners: Sides
    normals: Sides
    radius: float


@bodies.no_type_check
class Meeting:
    """One of `polygons.Meeting`."""

    normal: wp.vec2
    gaps: wp.vec2
    first: wp.vec2  # the two points, on the second polygon
    second: wp.vec2


@bodies.no_type_check
def star(shapes: Shapes, b: int) -> bool:
    """True for a star."""
    return shapes.rims[b, 2][1] > 0.0


@bodies.no_type_check
def nearest_arms(shapes: Shapes, b: int, towards: wp.vec2) -> wp.vec2i:
    """Of the directions of block b the nearest to a vector in its frame, and the next."""
    first, second = wp.int32(0), wp.int32(0)
    best = wp.dot(shapes.directions[b, 0], towards)
    other = wp.float32(-_LEAST)
    for k in range(1, 5):
        dot = wp.dot(shapes.directions[b, k], towards)
        if dot > best:
            second = first
            other = best
            first = k
            best = dot
        elif dot > other:
            second = k
            other = dot
    return wp.vec2i(first, second)


@bodies.no_type_check
def box_polygon(box: wp.vec4, tilt: wp.vec2, heading: wp.vec2, center: wp.vec2) -> Polygon:
    """A box of a part that has this heading, its centre `center`."""
    corners, normals = Sides(), Sides()
    at = wp.vec2(box[0], box[1])
    for k in range(4):
        x = wp.where(k == 0 or k == 3, box[2], -box[2])
        y = wp.where(k < 2, box[3], -box[3])
        ahead = wp.where(k == 0, 1.0, wp.where(k == 2, -1.0, 0.0))
        aside = wp.where(k == 1, -1.0, wp.where(k == 3, 1.0, 0.0))
        corner = out_of(at + out_of(wp.vec2(x, y), tilt), heading) + center
        normal = out_of(out_of(wp.vec2(aside, ahead), tilt), heading)
        corners[k, 0] = corner[0]
        corners[k, 1] = corner[1]
        normals[k, 0] = normal[0]
        normals[k, 1] = normal[1]
    return Polygon(4, corners, normals, 0.0)


@bodies.no_type_check
def _kite(shapes: Shapes, b: int, k: int):
    """Corner k of a star's arm along x, and the normal of the side that begins there."""
    tip, notch, out = shapes.rims[b, 0], shapes.rims[b, 1], shapes.rims[b, 2]
    inner = turned(notch) * (1.0 / wp.sqrt(wp.max(wp.dot(notch, notch), 1.0e-12)))
    if k == 0:
        return wp.vec2(0.0, 0.0), wp.vec2(inner[0], -inner[1])
    if k == 1:
        return wp.vec2(notch[0], -notch[1]), wp.vec2(out[0], -out[1])
    if k == 2:
        return tip, out
    return notch, inner


@bodies.no_type_check
def piece(shapes: Shapes, b: int, arm: int, heading: wp.vec2, center: wp.vec2) -> Polygon:
    """Block b, of a star the arm of that number, with this heading and centre."""
    corners, normals, count = Sides(), Sides(), wp.int32(5)
    if star(shapes, b):
        count = wp.int32(4)
    elif shapes.rims[b, 1][1] == 0.0:
        count = wp.int32(1)
    elif shapes.corners[b, 3] == shapes.corners[b, 4]:
        count = wp.int32(4)
    for k in range(count):
        corner, normal = wp.vec2(shapes.corners[b, k]), wp.vec2(shapes.directions[b, k])
        if star(shapes, b):
            along, across = _kite(shapes, b, k)
            corner = out_of(along, shapes.directions[b, arm])
            normal = out_of(across, shapes.directions[b, arm])
        corner = out_of(corner, heading) + center
        normal = out_of(normal, heading)
        corners[k, 0] = corner[0]
        corners[k, 1] = corner[1]
        normals[k, 0] = normal[0]
        normals[k, 1] = normal[1]
    return Polygon(count, corners, normals, shapes.sizes[b, 0])


@bodies.no_type_check
def _beyond(a: Polygon, b: Polygon):
    """The side of the first beyond which the second lies the furthest, and how far."""
    best, which = wp.float32(-_LEAST), wp.int32(0)
    if a.count > 1:
        for k in range(a.count):
            least = wp.float32(_LEAST)
            for j in range(b.count):
                least = wp.min(least, wp.dot(a.normals[k], b.corners[j]))
            least -= wp.dot(a.normals[k], a.corners[k])
            if least > best:
                best = least
                which = k
    return best, which


@bodies.no_type_check
def _facing(a: Polygon, n: wp.vec2):
    """The ends of the side that faces a direction."""
    best, which = wp.dot(a.normals[0], n), wp.int32(0)
    for k in range(1, a.count):
        dot = wp.dot(a.normals[k], n)
        if dot > best:
            best = dot
            which = k
    following = which + 1
    if following >= a.count:
        following = 0
    return a.corners[which], a.corners[following]


@bodies.no_type_check
def _corners_apart(a: Polygon, b: Polygon, n: wp.vec2):
    """The way between the nearest corners of two polygons that are not face to face; else zero."""
    e, to_e = _facing(a, n)
    f, to_f = _facing(b, -n)
    if cross(to_e, n) < cross(e, n):
        last = e
        e = to_e
        to_e = last
    if cross(to_f, n) < cross(f, n):
        last = f
        f = to_f
        to_f = last
    if cross(f, n) > cross(to_e, n):
        return f - to_e
    if cross(to_f, n) < cross(e, n):
        return to_f - e
    return wp.vec2(0.0, 0.0)


@bodies.no_type_check
def _on(start: wp.vec2, end: wp.vec2, low: float, high: float, at: float) -> wp.vec2:
    """The point of a side, its ends at `low` and `high`, that is at a place or nearest to it."""
    share, width = wp.float32(0.0), high - low
    if wp.abs(width) >= NARROW:
        share = wp.clamp((at - low) / width, 0.0, 1.0)
    return start + (end - start) * share


@bodies.no_type_check
def meet(a: Polygon, b: Polygon) -> Meeting:
    """Contact of two polygons; a gap that is positive is only some such number."""
    met = Meeting()
    met.gaps = wp.vec2(FAR, FAR)
    n, apart, rounded = wp.vec2(), wp.float32(0.0), a.radius + b.radius
    if a.count == 1 and b.count == 1:
        way = b.corners[0] - a.corners[0]
        n = way * (1.0 / wp.sqrt(wp.dot(way, way) + 1.0e-14))
    else:
        beyond, mine = _beyond(a, b)
        if beyond > rounded:
            return met
        behind, theirs = _beyond(b, a)
        apart = wp.max(beyond, behind)
        if apart > rounded:
            return met
        n = wp.where(beyond >= behind, a.normals[mine], -b.normals[theirs])
        if apart > 0.0:
            way = _corners_apart(a, b, n)
            length = wp.dot(way, way)
            if length > 0.0:
                n = way * (1.0 / wp.sqrt(length + 1.0e-14))
    e, to_e = _facing(a, n)
    f, to_f = _facing(b, -n)
    low_e, high_e, low_f, high_f = cross(e, n), cross(to_e, n), cross(f, n), cross(to_f, n)
    p, q = _on(e, to_e, low_e, high_e, high_f), _on(f, to_f, low_f, high_f, low_e)
    met.normal = n
    met.first = q - n * b.radius
    met.gaps[0] = wp.dot(q - p, n) - rounded
    if a.count > 1 and b.count > 1:
        p, q = _on(e, to_e, low_e, high_e, low_f), _on(f, to_f, low_f, high_f, high_e)
        met.second = q - n * b.radius
        met.gaps[1] = wp.dot(q - p, n) - rounded
    return met


@bodies.no_type_check
def to_box(box: wp.vec4, tilt: wp.vec2, point: wp.vec2) -> wp.vec2:
    """The way from a point to the nearest one of a box, both in the part's frame."""
    local = into(point - wp.vec2(box[0], box[1]), tilt)
    nearest = wp.vec2(wp.clamp(local[0], -box[2], box[2]), wp.clamp(local[1], -box[3], box[3]))
    return out_of(nearest - local, tilt)
