"""The search for contacts in the kernel, in the order of `physics.Physics`'s layers.

Pairs whose circles do not meet are skipped, and of what is found only what touches becomes a row:
as in Chipmunk, bodies that are yet apart do not feel each other.
"""

from typing import no_type_check

import warp as wp

from .outlines import Part, Shapes, block_distance, box_distance, into, out_of
from .rows import Row, Touch, append, deeper, nothing, prepared

MIDDLE = wp.constant(1.0e-6)
BLOCK_FRICTION = wp.constant(0.5)
WALL_FRICTION = wp.constant(0.8)


@wp.struct
@no_type_check
class Scene:
    """Sizes of one episode's scene."""

    parts: int
    blocks: int
    arena: float
    rate: float  # share of an overlap that is undone in a second


@wp.func
@no_type_check
def _between(pose: wp.array(dtype=wp.vec3), first: int, second: int) -> wp.vec2:
    """The way from one body's centre to another's."""
    way = pose[second] - pose[first]
    return wp.vec2(way[0], way[1])


@wp.func
@no_type_check
def _box_on_block(
    part: Part, at: wp.vec2, offset: wp.vec2, shapes: Shapes, b: int, heading: wp.vec2
):
    """The contacts of a part of boxes, its heading `at`, with block b, `offset` away.

    Of two, one is right of the block's middle along the part's longer side, the other left of it.
    """
    right, left = nothing(), nothing()
    axis = wp.where(part.upper[2] > part.upper[3], 0, 1)
    radius, middle = shapes.sizes[b, 0], into(offset, at)
    for k in range(5):
        corner = out_of(shapes.corners[b, k], heading)
        local = into(corner + offset, at)
        for box in range(part.boxes):
            if box == 0:
                distance, out = box_distance(part.upper, wp.vec2(1.0, 0.0), local, middle)
            else:
                distance, out = box_distance(part.fore, part.tilt, local, middle)
            out = out_of(out, at)
            second = corner - out * radius
            if into(second, at)[axis] >= -MIDDLE:
                right = deeper(right, distance - radius, out, second)
            else:
                left = deeper(left, distance - radius, out, second)
    tip = wp.where(part.boxes > 1, part.fore, part.upper)
    middle = into(out_of(wp.vec2(tip[0], tip[1]), at) - offset, heading)
    for k in range(part.corners):
        point = out_of(wp.vec2(part.ends[2 * k], part.ends[2 * k + 1]), at) - offset
        gap, out = block_distance(shapes, b, into(point, heading), middle, True, 0.0)
        out = out_of(out, heading)
        second = point - out * gap
        if into(second, at)[axis] >= -MIDDLE:
            right = deeper(right, gap, -out, second)
        else:
            left = deeper(left, gap, -out, second)
    return right, left


@wp.func
@no_type_check
def _of_part(
    p: int, layer: int, parts: wp.array(dtype=Part), shapes: Shapes, scene: Scene,
    pose: wp.array(dtype=wp.vec3), heading: wp.array(dtype=wp.vec2),
    weights: wp.array(dtype=wp.vec2), memory: wp.array(dtype=float),
    lefts: wp.array(dtype=Touch), rows: wp.array(dtype=Row), count: int,
) -> int:  # fmt: skip
    """Appends the rows of one part with the blocks: a layer of a disc, two of boxes."""
    part = parts[p]
    n = wp.int32(count)
    friction, wide = part.friction * BLOCK_FRICTION, scene.blocks
    for b in range(scene.blocks):
        body = scene.parts + b
        offset = _between(pose, p, body)
        lefts[b] = nothing()
        near = part.reach + shapes.sizes[b, 2]
        if wp.dot(offset, offset) <= near * near:
            touch = nothing()
            if part.boxes == 0:
                point = into(-offset, heading[body])
                distance, out = block_distance(shapes, b, point, point, False, part.radius)
                out = out_of(out, heading[body])
                touch = Touch(distance - part.radius, -out, -(offset + out * distance))
            else:
                touch, left = _box_on_block(part, heading[p], offset, shapes, b, heading[body])
                lefts[b] = left
            if touch.gap <= 0.0:
                row = prepared(touch, p, body, friction, scene.rate, pose, weights)
                n = append(rows, n, row, layer, 2 * wide * layer + b, wide, memory)
    for b in range(scene.blocks):
        if lefts[b].gap <= 0.0:
            row = prepared(lefts[b], p, scene.parts + b, friction, scene.rate, pose, weights)
            n = append(rows, n, row, layer + 1, 2 * wide * (layer + 1) + b, wide, memory)
    return n


@wp.func
@no_type_check
def _of_pair(
    i: int, j: int, layer: int, shapes: Shapes, scene: Scene,
    pose: wp.array(dtype=wp.vec3), heading: wp.array(dtype=wp.vec2),
    weights: wp.array(dtype=wp.vec2), memory: wp.array(dtype=float),
    rows: wp.array(dtype=Row), count: int,
) -> int:  # fmt: skip
    """Appends the row of block i's deepest corner in block j, if there is one."""
    first, second, wide = scene.parts + i, scene.parts + j, scene.blocks
    offset = _between(pose, first, second)
    near = shapes.sizes[i, 2] + shapes.sizes[j, 2]
    if wp.dot(offset, offset) > near * near:
        return count
    best, radius = nothing(), shapes.sizes[i, 0]
    for k in range(5):
        point = out_of(shapes.corners[i, k], heading[first]) - offset
        inside = into(point, heading[second])
        distance, out = block_distance(shapes, j, inside, inside, False, radius)
        out = out_of(out, heading[second])
        best = deeper(best, distance - radius, -out, point - out * distance)
    if best.gap > 0.0:
        return count
    friction = BLOCK_FRICTION * BLOCK_FRICTION
    row = prepared(best, first, second, friction, scene.rate, pose, weights)
    return append(rows, count, row, layer, 2 * wide * layer + i, wide, memory)


@wp.func
@no_type_check
def _corner(parts: wp.array(dtype=Part), shapes: Shapes, scene: Scene, e: int, k: int) -> wp.vec2:
    """Corner k of any body, in its own frame."""
    if e >= scene.parts:
        return shapes.corners[e - scene.parts, k]
    return wp.vec2(parts[e].ends[2 * k], parts[e].ends[2 * k + 1])


@wp.func
@no_type_check
def _of_walls(
    e: int, slot: int, width: int, parts: wp.array(dtype=Part), shapes: Shapes, scene: Scene,
    pose: wp.array(dtype=wp.vec3), heading: wp.array(dtype=wp.vec2),
    weights: wp.array(dtype=wp.vec2), memory: wp.array(dtype=float),
    rows: wp.array(dtype=Row), count: int,
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


@wp.func
@no_type_check
def find_rows(
    parts: wp.array(dtype=Part), shapes: Shapes, scene: Scene,
    pose: wp.array(dtype=wp.vec3), heading: wp.array(dtype=wp.vec2),
    weights: wp.array(dtype=wp.vec2), memory: wp.array(dtype=float),
    lefts: wp.array(dtype=Touch), rows: wp.array(dtype=Row),
) -> int:  # fmt: skip
    """Lists all that touches, with the impulses in `memory`; returns how many rows there are."""
    count, layer, wide = wp.int32(0), wp.int32(0), scene.blocks
    for p in range(scene.parts):
        count = _of_part(
            p, layer, parts, shapes, scene, pose, heading, weights, memory, lefts, rows, count
        )
        layer += wp.where(parts[p].boxes > 0, 2, 1)
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
