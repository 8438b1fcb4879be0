"""Contacts of planar bodies: a fixed list of layers, each with one possible one a block.

A layer holds, for every block at once, the contact with one part of the robot, with another block,
or with a wall. Contacts that are not there are switched off by their gap: nothing is sorted,
gathered or sized at run time. Two flat sides that meet have two points, which lie in two layers.

`fence` keeps XLA from repeating a search for every field of its result.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .plane import Vec, fence, heading, where
from .robots import Box, Part
from .shapes import BlockShape, signed_distance

_FAR = 1e3
_MIDDLE = 1e-6  # arena units; a circle that lies on a side would else change layers by rounding


class Frames(NamedTuple):
    """The places of N bodies."""

    center: Vec
    heading: Vec  # cosine and sine of the angle


def frames(pose: Float[Array, "N 3"]) -> Frames:
    """The places of bodies at x, y, angle."""
    return Frames(Vec(pose[:, 0], pose[:, 1]), heading(pose[:, 2]))


class Contacts(NamedTuple):
    """Contacts between N first and N second bodies, or candidates (K, N) for them."""

    gap: Float[Array, "*N"]  # negative where they overlap
    normal: Vec  # from the first body to the second
    second: Vec  # contact point relative to the second body's centre


def _deepest(candidates: Contacts, allowed: Array | None = None) -> Contacts:
    """The deepest allowed one of K candidates."""
    gap = candidates.gap if allowed is None else jnp.where(allowed, candidates.gap, _FAR)
    best = Contacts(gap[0], candidates.normal[0], candidates.second[0])
    for k in range(1, len(gap)):
        deeper = gap[k] < best.gap
        best = Contacts(
            jnp.minimum(gap[k], best.gap),
            where(deeper, candidates.normal[k], best.normal),
            where(deeper, candidates.second[k], best.second),
        )
    return fence(best)


def with_part(part: Part, at: Frames, shapes: BlockShape, blocks: Frames) -> list[Contacts]:
    """Layers of a robot's part (first) with the blocks (second): one for a disc, two for boxes.

    Of two, one holds the deepest point right of the block's middle, the other the one left of it.
    """
    offset = blocks.center - at.center
    if not part.boxes:
        distance, out = signed_distance(shapes, (-offset).into(blocks.heading))
        out = out.out_of(blocks.heading)
        touch = -(offset + out * distance)
        return [fence(Contacts(distance - part.radius, -out, touch))]
    found = [*_corners_in_boxes(part.boxes, at, offset, shapes, blocks)]
    found.append(_part_in_blocks(part, at, offset, shapes, blocks))
    candidates = fence(jax.tree.map(lambda *f: jnp.concatenate(f), *found))
    local = candidates.second.into(at.heading)
    # Along the longer side of the part: x for a stick, y for a finger.
    right = (local.x if part.boxes[0].half[0] > part.boxes[0].half[1] else local.y) >= -_MIDDLE
    return [_deepest(candidates, side) for side in (right, ~right)]


def _corners_in_boxes(boxes, at: Frames, offset: Vec, shapes: BlockShape, blocks: Frames):
    """Contacts of each corner of each block with each box, (5, B) each."""
    corners = shapes.corners.out_of(blocks.heading)
    local, middle = (corners + offset).into(at.heading), offset.into(at.heading)
    for box in boxes:
        distance, out = _box_distance(box, local, middle)
        out = out.out_of(at.heading)
        yield Contacts(distance - shapes.radius, out, corners - out * shapes.radius)


def _part_in_blocks(part: Part, at: Frames, offset: Vec, shapes: BlockShape, blocks: Frames):
    """Contacts of each of the part's corners with each block, (C, B)."""
    corners = part.corners.astype(np.float32)
    point = Vec(corners[:, :1], corners[:, 1:]).out_of(at.heading) - offset
    tip = np.float32(part.boxes[-1].center)  # a finger's forearm has all its corners
    middle = Vec(tip[0], tip[1]).out_of(at.heading) - offset
    gap, out = signed_distance(shapes, point.into(blocks.heading), middle.into(blocks.heading))
    out = out.out_of(blocks.heading)
    return Contacts(gap, -out, point - out * gap)


def _box_distance(box: Box, point: Vec, middle: Vec) -> tuple[Array, Vec]:
    """Signed distance of a block's corners to a rectangle, and its outward normal.

    A corner inside leaves through the face that it came in by: the one beyond which most of the
    way from the corner to the block's middle lies. The nearest face may be another one, above all
    at the ends of a thin box, and would let the block through.
    """
    tilt = Vec(np.float32(np.cos(box.angle)), np.float32(np.sin(box.angle)))
    centre = Vec(np.float32(box.center[0]), np.float32(box.center[1]))
    local, middle = (point - centre).into(tilt), (middle - centre).into(tilt)
    side = Vec(_sign(middle.x), _sign(middle.y))
    dx, dy = jnp.abs(local.x) - box.half[0], jnp.abs(local.y) - box.half[1]
    corner = Vec(jnp.maximum(dx, 0.0), jnp.maximum(dy, 0.0))
    far = jnp.sqrt(corner.dot(corner) + 1e-14)
    outside = far > 1e-6
    in_x, in_y = local.x * side.x - box.half[0], local.y * side.y - box.half[1]
    reach_x = jnp.minimum(in_x, jnp.abs(middle.x) - box.half[0])
    reach_y = jnp.minimum(in_y, jnp.abs(middle.y) - box.half[1])
    wide = reach_x > reach_y
    out = where(
        outside,
        Vec(corner.x * _sign(local.x), corner.y * _sign(local.y)) * (1.0 / far),
        Vec(jnp.where(wide, side.x, 0.0), jnp.where(wide, 0.0, side.y)),
    )
    return jnp.where(outside, far, jnp.where(wide, in_x, in_y)), out.out_of(tilt)


def _sign(x: Array) -> Array:
    return jnp.where(x < 0, -1.0, 1.0)


def between_blocks(shapes: BlockShape, blocks: Frames) -> list[Contacts]:
    """Layers k = 1 ... B - 1: the deepest corner of block i (first) in block i + k mod B (second).

    So each pair occurs twice, once with the corners of either block.
    """
    corners = fence(shapes.corners.out_of(blocks.heading))
    layers = []
    for k in range(1, len(shapes.radius)):
        moved = lambda f, k=k: jnp.roll(f, -k, axis=-1)  # noqa: E731
        other, faces = jax.tree.map(moved, (blocks, shapes))
        point = corners - (other.center - blocks.center)
        distance, out = signed_distance(faces, point.into(other.heading))
        out = out.out_of(other.heading)
        found = Contacts(distance - shapes.radius, -out, point - out * distance)
        layers.append(_deepest(fence(found)))
    return layers


def walls(
    corners: Vec, radius: Float[Array | np.ndarray, "N"], bodies: Frames, *, arena: float
) -> list[Contacts]:
    """Four layers of bodies (second) with the walls |x| = arena and |y| = arena (first).

    For each axis the nearer wall, and for each wall the deepest corner on either side of the body's
    centre. `corners` are (C, N), in the bodies' frames.
    """
    corners = corners.out_of(bodies.heading)
    layers = []
    for axis in (0, 1):
        at = bodies.center.x if axis == 0 else bodies.center.y
        inward = jnp.where(at < 0, 1.0, -1.0)
        none = jnp.zeros_like(inward)
        normal = Vec(inward, none) if axis == 0 else Vec(none, inward)
        reach, along = (corners.x, corners.y) if axis == 0 else (corners.y, corners.x)
        gap = arena - radius + inward * (at + reach)
        normals = jax.tree.map(lambda f, g=gap: jnp.broadcast_to(f, g.shape), normal)
        found = Contacts(gap, normals, corners - normal * radius)
        layers += [_deepest(found, side) for side in (along >= 0, along < 0)]
    return layers
