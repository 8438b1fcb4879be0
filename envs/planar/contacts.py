"""Contacts of planar bodies: a fixed list of layers, each with one possible one a block.

A layer holds, for every block at once, the contact with one part of the robot, with another block,
or with a wall; those that are not there are switched off by their gap. Two flat sides that meet
have two points, which lie in two layers. What touches, and where, is `polygons`' affair.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .plane import Vec, fence, heading, where
from .polygons import FAR, Meeting, box_polygon, is_round, is_star, meet, nearest_arms, pieces
from .robots import Box, Part
from .shapes import BlockShape, arm_distance


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
    gap = candidates.gap if allowed is None else jnp.where(allowed, candidates.gap, FAR)
    best = Contacts(gap[0], candidates.normal[0], candidates.second[0])
    for k in range(1, len(gap)):
        deeper = gap[k] < best.gap
        best = Contacts(
            jnp.minimum(gap[k], best.gap),
            where(deeper, candidates.normal[k], best.normal),
            where(deeper, candidates.second[k], best.second),
        )
    return fence(best)


def layers_of(part: Part) -> int:
    """Number of layers that `with_part` has for a part."""
    return 2 * max(len(part.boxes), 1)


def with_part(part: Part, at: Frames, shapes: BlockShape, blocks: Frames) -> list[Contacts]:
    """Two layers of a disc (first), or of each of a part's boxes, with the blocks (second)."""
    away = at.center - blocks.center
    if not part.boxes:
        return _with_disc(part.radius, away, shapes, blocks)
    to_box = _stack([_nearest(box, at, away) for box in part.boxes])
    arms = _stack(nearest_arms(shapes, to_box.into(blocks.heading)))
    stars = pieces(shapes, arms).placed(blocks.heading)
    boxes = jax.tree.map(lambda *f: np.stack(f, -1), *map(box_polygon, part.boxes))
    boxes = jax.tree.map(lambda f: f[..., None, :, None], boxes)  # sides, arms, boxes, blocks
    found = fence(meet(boxes.placed(at.heading, away), stars))
    layers = []
    for k in range(len(part.boxes)):
        near, far = (jax.tree.map(lambda f, arm=arm, k=k: f[arm, k], found) for arm in (0, 1))
        layers += _two(near, far, is_star(shapes))
    return layers


def _stack(vectors: Sequence[Vec]) -> Vec:
    return jax.tree.map(lambda *f: jnp.stack(f), *vectors)


def _with_disc(radius: float, away: Vec, shapes: BlockShape, blocks: Frames) -> list[Contacts]:
    """A layer of the blocks, or of the nearest arm of stars, and one of the next arm."""
    point, layers = away.into(blocks.heading), []
    for arm in nearest_arms(shapes, point):
        distance, out = arm_distance(shapes, point, arm)
        out = out.out_of(blocks.heading)
        layers.append(fence(Contacts(distance - radius, -out, away - out * distance)))
    gap = jnp.where(is_star(shapes), layers[1].gap, FAR)
    return [layers[0], layers[1]._replace(gap=gap)]


def _nearest(box: Box, at: Frames, away: Vec) -> Vec:
    """The ways (B,) from the blocks' centres to the nearest point of a box."""
    tilt = Vec(np.float32(np.cos(box.angle)), np.float32(np.sin(box.angle)))
    centre = Vec(np.float32(box.center[0]), np.float32(box.center[1]))
    local = ((-away).into(at.heading) - centre).into(tilt)
    half = box.half
    nearest = Vec(jnp.clip(local.x, -half[0], half[0]), jnp.clip(local.y, -half[1], half[1]))
    return (nearest - local).out_of(tilt).out_of(at.heading)


def _two(near: Meeting, far: Meeting, star: Array) -> list[Contacts]:
    """Of the points with two arms the two that count: the deeper of each, if both touch."""
    first, second = _points(near)
    other = [_off(c, ~star) for c in _points(far)]
    deepest, others = _deeper(first, second), _deeper(*other)
    one, two = deepest.gap <= 0.0, others.gap <= 0.0
    both, only = one & two, two & ~one
    return [
        fence(_pick(both, deepest, _pick(only, other[0], first))),
        fence(_pick(both, others, _pick(only, other[1], second))),
    ]


def _points(met: Meeting) -> list[Contacts]:
    return [Contacts(gap, met.normal, q) for gap, q in zip(met.gaps, met.points, strict=True)]


def _off(contacts: Contacts, which: Array) -> Contacts:
    return contacts._replace(gap=jnp.where(which, FAR, contacts.gap))


def _pick(which: Array, a: Contacts, b: Contacts) -> Contacts:
    return Contacts(jnp.where(which, a.gap, b.gap), *map(where, [which] * 2, a[1:], b[1:]))


def _deeper(a: Contacts, b: Contacts) -> Contacts:
    return _pick(a.gap <= b.gap, a, b)


def between_blocks(shapes: BlockShape, blocks: Frames) -> list[Contacts]:
    """Layers k = 1 ... B - 1: the first point of block i (first) with i + k mod B (second).

    So each pair occurs twice: what is the first point in one order is the second in the other,
    which a circle has not.
    """
    ahead = range(1, len(shapes.radius))
    if not ahead:
        return []
    moved = lambda f: jnp.stack([jnp.roll(f, -k, axis=-1) for k in ahead], axis=-2)  # noqa: E731
    there, others = jax.tree.map(moved, (blocks, shapes))
    away = blocks.center - there.center
    mine = nearest_arms(shapes, (-away).into(blocks.heading))
    theirs = nearest_arms(others, away.into(there.heading))
    mine, theirs = (_stack([arms[k] for k in order]) for arms, order in
                    ((mine, (0, 1, 0)), (theirs, (0, 0, 1))))  # fmt: skip
    a = pieces(shapes, mine).placed(blocks.heading, away)
    found = fence(meet(a, pieces(others, theirs).placed(there.heading)))
    best, first = jnp.minimum(*found.gaps), _points(found)[0]
    stars = (True, is_star(shapes), is_star(others))
    best = [jnp.where(star, gap, FAR) for star, gap in zip(stars, best, strict=True)]
    tried = [jax.tree.map(lambda f, k=k: f[k], first) for k in range(3)]
    chosen = _pick(best[1] < best[0], tried[1], tried[0])
    chosen = _pick(best[2] < jnp.minimum(*best[:2]), tried[2], chosen)
    index = np.arange(len(shapes.radius))
    back = np.array([index + k >= len(index) for k in ahead])  # the pair's second time
    chosen = _off(chosen, back & (is_round(shapes) | is_round(others)))
    return [jax.tree.map(lambda f, k=k: f[k - 1], chosen) for k in ahead]


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
