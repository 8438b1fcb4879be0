"""The search for contacts in the kernel, in the order of `physics.Physics`'s layers.

Pairs whose circles do not meet are skipped, and of what is found only what touches becomes a row:
as in Chipmunk, bodies that are yet apart do not feel each other.
"""

import warp as wp

from . import bodies
from .bodies import Floats, Part, Shapes, Vec2s, Vec3s, arm_distance, into, out_of
from .polygons import box_polygon, meet, nearest_arms, piece, star, to_box
from .rows import Row, Touch, append, deeper, nothing, prepared

BLOCK_FRICTION = wp.constant(0.5)
WALL_FRICTION = wp.constant(0.8)


@bodies.no_type_check
class Scene:
    """Sizes of one episode's scene."""

    parts: int
    blocks: int
    arena: float
    rate: float  # share of an overlap that is undone in a second


@bodies.no_type_check
def _between(pose: Vec3s, first: int, second: int) -> wp.vec2:
    """The way from one body's centre to another's."""
    way = pose[second] - pose[first]
    return wp.vec2(way[0], way[1])


@bodies.no_type_check
def _disc_on_block(radius: float, offset: wp.vec2, shapes: Shapes, b: int, heading: wp.vec2):
    """The contacts of a disc with block b, `offset` away, or with the nearest arms of a star."""
    point = into(-offset, heading)
    arms = nearest_arms(shapes, b, point)
    distance, out = arm_distance(shapes, b, arms[0], point, radius)
    out = out_of(out, heading)
    first = Touch(distance - radius, -out, -(offset + out * distance))
    second = nothing()
    if star(shapes, b):
        distance, out = arm_distance(shapes, b, arms[1], point, radius)
        out = out_of(out, heading)
        second = Touch(distance - radius, -out, -(offset + out * distance))
    return first, second


@bodies.no_type_check
def _box_on_block(
    box: wp.vec4, tilt: wp.vec2, at: wp.vec2, offset: wp.vec2, shapes: Shapes, b: int,
    heading: wp.vec2,
):  # fmt: skip
    """The contacts of a box, its part's heading `at`, with block b, `offset` away from the part."""
    first, second, reach = nothing(), nothing(), shapes.sizes[b, 2]
    way = to_box(box, tilt, into(offset, at))
    if wp.dot(way, way) > reach * reach:
        return first, second
    polygon = box_polygon(box, tilt, at, -offset)
    arms = nearest_arms(shapes, b, into(out_of(way, at), heading))
    met = meet(polygon, piece(shapes, b, arms[0], heading, wp.vec2(0.0, 0.0)))
    first = Touch(met.gaps[0], met.normal, met.first)
    second = Touch(met.gaps[1], met.normal, met.second)
    if star(shapes, b):
        met = meet(polygon, piece(shapes, b, arms[1], heading, wp.vec2(0.0, 0.0)))
        third = Touch(met.gaps[0], met.normal, met.first)
        fourth = Touch(met.gaps[1], met.normal, met.second)
        if wp.min(met.gaps[0], met.gaps[1]) <= 0.0:
            if wp.min(first.gap, second.gap) <= 0.0:  # the deeper of each arm
                if second.gap < first.gap:
                    first = second
                second = third
                if fourth.gap < third.gap:
                    second = fourth
            else:
                first = third
                second = fourth
    return first, second


@bodies.no_type_check
def _of_part(
    p: int, layer: int, parts: wp.array(dtype=Part), shapes: Shapes, scene: Scene, pose: Vec3s,
    heading: Vec2s, weights: Vec2s, memory: Floats, others: wp.array(dtype=Touch),
    rows: wp.array(dtype=Row), count: int,
) -> int:  # fmt: skip
    """Appends the rows of one part with the blocks: two layers of a disc or of each box."""
    part = parts[p]
    n = wp.int32(count)
    friction, wide, above = part.friction * BLOCK_FRICTION, scene.blocks, wp.int32(layer)
    for box in range(wp.max(part.boxes, 1)):
        for b in range(scene.blocks):
            body = scene.parts + b
            offset = _between(pose, p, body)
            others[b] = nothing()
            near = part.reach + shapes.sizes[b, 2]
            if wp.dot(offset, offset) <= near * near:
                if part.boxes == 0:
                    touch, other = _disc_on_block(part.radius, offset, shapes, b, heading[body])
                elif box == 0:
                    touch, other = _box_on_block(
                        part.upper, wp.vec2(1.0, 0.0), heading[p], offset, shapes, b, heading[body]
                    )
                else:
                    touch, other = _box_on_block(
                        part.fore, part.tilt, heading[p], offset, shapes, b, heading[body]
                    )
                others[b] = other
                if touch.gap <= 0.0:
                    row = prepared(touch, p, body, friction, scene.rate, pose, weights)
                    n = append(rows, n, row, above, 2 * wide * above + b, wide, memory)
        above += 1
        for b in range(scene.blocks):
            if others[b].gap <= 0.0:
                row = prepared(others[b], p, scene.parts + b, friction, scene.rate, pose, weights)
                n = append(rows, n, row, above, 2 * wide * above + b, wide, memory)
        above += 1
    return n


@bodies.no_type_check
def _of_pair(
    i: int, j: int, layer: int, shapes: Shapes, scene: Scene, pose: Vec3s, heading: Vec2s,
    weights: Vec2s, memory: Floats, rows: wp.array(dtype=Row), count: int,
) -> int:  # fmt: skip
    """Appends the row of the first point of block i with block j, if there is one."""
    first, second, wide = scene.parts + i, scene.parts + j, scene.blocks
    offset = _between(pose, first, second)
    near = shapes.sizes[i, 2] + shapes.sizes[j, 2]
    if wp.dot(offset, offset) > near * near:
        return count
    at, there, middle = heading[first], heading[second], wp.vec2(0.0, 0.0)
    mine = nearest_arms(shapes, i, into(offset, at))
    theirs = nearest_arms(shapes, j, into(-offset, there))
    a = piece(shapes, i, mine[0], at, -offset)
    b = piece(shapes, j, theirs[0], there, middle)
    best = meet(a, b)
    if star(shapes, i):
        met = meet(piece(shapes, i, mine[1], at, -offset), b)
        if wp.min(met.gaps[0], met.gaps[1]) < wp.min(best.gaps[0], best.gaps[1]):
            best = met
    if star(shapes, j):
        met = meet(a, piece(shapes, j, theirs[1], there, middle))
        if wp.min(met.gaps[0], met.gaps[1]) < wp.min(best.gaps[0], best.gaps[1]):
            best = met
    if best.gaps[0] > 0.0 or (i > j and (a.count == 1 or b.count == 1)):
        return count
    friction = BLOCK_FRICTION * BLOCK_FRICTION
    touch = Touch(best.gaps[0], best.normal, best.first)
    row = prepared(touch, first, second, friction, scene.rate, pose, weights)
    return append(rows, count, row, layer, 2 * wide * layer + i, wide, memory)


@bodies.no_type_check
def _corner(parts: wp.array(dtype=Part), shapes: Shapes, scene: Scene, e: int, k: int) -> wp.vec2:
    """Corner k of any body, in its own frame."""
    if e >= scene.parts:
        return shapes.corners[e - scene.parts, k]
    return wp.vec2(parts[e].ends[2 * k], parts[e].ends[2 * k + 1])


@bodies.no_type_check
def _of_walls(
    e: int, slot: int, width: int, parts: wp.array(dtype=Part), shapes: Shapes, scene: Scene,
    pose: Vec3s, heading: Vec2s, weights: Vec2s, memory: Floats, rows: wp.array(dtype=Row),
    count: int,
) -> int:  # fmt: skip
    """Appends the rows of body e with the walls: the nearer of each axis, on either side."""
    n, corners = wp.int32(count), wp.int32(5)
    reach, radius, friction = wp.float32(0.0), wp.float32(0.0), wp.float32(0.0)
    if e < scene.parts:
        corners = parts[e].corners
        reach = parts[e].reach
        radius = parts[e].radius
        friction = WALL_FRICTION * parts[e].friction
    else:
        radius = shapes.sizes[e - scene.parts, 0]
        reach = shapes.sizes[e - scene.parts, 2]
        friction = WALL_FRICTION * BLOCK_FRICTION
    for axis in range(2):
        at = pose[e][axis]
        if scene.arena - wp.abs(at) <= reach:
            inward = wp.where(at < 0.0, 1.0, -1.0)
            normal = wp.where(axis == 0, wp.vec2(inward, 0.0), wp.vec2(0.0, inward))
            right, left = nothing(), nothing()
            for k in range(corners):
                corner = out_of(_corner(parts, shapes, scene, e, k), heading[e])
                gap = scene.arena - radius + inward * (at + corner[axis])
                if corner[1 - axis] >= 0.0:
                    right = deeper(right, gap, normal, corner - normal * radius)
                else:
                    left = deeper(left, gap, normal, corner - normal * radius)
            for side in range(2):
                touch = right
                if side == 1:
                    touch = left
                if touch.gap <= 0.0:
                    row = prepared(touch, -1, e, friction, scene.rate, pose, weights)
                    at_slot = slot + 2 * width * (2 * axis + side)
                    n = append(rows, n, row, -1 - n, at_slot, width, memory)
    return n


@bodies.no_type_check
def find_rows(
    parts: wp.array(dtype=Part), shapes: Shapes, scene: Scene, pose: Vec3s, heading: Vec2s,
    weights: Vec2s, memory: Floats, others: wp.array(dtype=Touch), rows: wp.array(dtype=Row),
) -> int:  # fmt: skip
    """Lists all that touches, with the impulses in `memory`; returns how many rows there are."""
    count, layer, wide = wp.int32(0), wp.int32(0), scene.blocks
    for p in range(scene.parts):
        count = _of_part(
            p, layer, parts, shapes, scene, pose, heading, weights, memory, others, rows, count
        )
        layer += 2 * wp.max(parts[p].boxes, 1)
    for k in range(1, wide):
        for i in range(wide):
            count = _of_pair(
                i, (i + k) % wide, layer, shapes, scene, pose, heading, weights, memory, rows, count
            )
        layer += 1
    slot = 2 * wide * layer
    for e in range(scene.parts):
        count = _of_walls(
            e, slot + e, scene.parts, parts, shapes, scene, pose, heading, weights, memory, rows,
            count,
        )  # fmt: skip
    slot += 8 * scene.parts
    for b in range(wide):
        count = _of_walls(
            scene.parts + b, slot + b, wide, parts, shapes, scene, pose, heading, weights, memory,
            rows, count,
        )  # fmt: skip
    return count
