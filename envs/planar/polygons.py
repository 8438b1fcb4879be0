"""Contacts of convex polygons and circles, as the original's engine, Chipmunk, finds them.

Two polygons touch along one normal: that of the side beyond which the other lies the furthest, or
overlaps the least. The two sides that face each other along it meet in one point or two. A star is
no convex polygon, but five: its arms, kites from its centre, of which the two that lie nearest to
the other body are looked at.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .plane import Vec, fence, where
from .robots import Box
from .shapes import BlockShape

FAR = 1e3
_NARROW = 1e-9  # arena units; a side that is seen from its end has no width


class Polygon(NamedTuple):
    """Convex polygons of K sides, counter-clockwise, their trailing axes those of many."""

    start: Vec  # (K, ...) corners; repeated with their sides where there are fewer
    end: Vec  # (K, ...) the next corners
    normal: Vec  # (K, ...) of the sides, outwards
    radius: Float[Array, "..."]  # by which they are rounded
    round: Bool[Array, "..."]  # it is a circle: all corners are its centre

    def placed(self, heading: Vec, center: Vec | None = None) -> "Polygon":
        """The polygons turned out of a frame, and moved."""
        start, end = self.start.out_of(heading), self.end.out_of(heading)
        if center is not None:
            start, end = start + center, end + center
        return self._replace(start=start, end=end, normal=self.normal.out_of(heading))


class Meeting(NamedTuple):
    """Contacts of N first with N second polygons: two points along one normal."""

    normal: Vec  # from the first to the second
    gaps: tuple[Float[Array, "..."], Float[Array, "..."]]  # negative where they overlap
    points: tuple[Vec, Vec]  # on the second


def box_polygon(box: Box) -> Polygon:
    """A rectangle in its part's frame, its arrays (4,)."""
    c, s = np.cos(box.angle), np.sin(box.angle)
    turn = np.array([[c, s], [-s, c]])
    start = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * box.half @ turn + box.center
    normal = np.array([[0, 1], [-1, 0], [0, -1], [1, 0]]) @ turn
    vec = lambda v: Vec(*np.float32(v.T))  # noqa: E731
    return Polygon(
        vec(start), vec(np.roll(start, -1, axis=0)), vec(normal), np.float32(0), np.bool_(False)
    )


def is_star(shapes: BlockShape) -> Bool[Array, "*B"]:
    """True for stars."""
    return shapes.rim_out.y > 0.0


def is_round(shapes: BlockShape) -> Bool[Array, "*B"]:
    """True for circles, and for slots without a block."""
    return shapes.rim_end.y == 0.0


def nearest_arms(shapes: BlockShape, towards: Vec) -> tuple[Vec, Vec]:
    """Of the directions the nearest to a vector (..., B) in the blocks' frames, and the next."""
    dots = [shapes.directions[k].dot(towards) for k in range(5)]
    first, best = shapes.directions[0], dots[0]
    second, next_best = jax.tree.map(jnp.zeros_like, first), jnp.full_like(best, -jnp.inf)
    for k in range(1, 5):
        direction, dot = shapes.directions[k], dots[k]
        ahead, between = dot > best, dot > next_best
        second = where(ahead, first, where(between, direction, second))
        next_best = jnp.where(ahead, best, jnp.maximum(next_best, dot))
        first = where(ahead, direction, first)
        best = jnp.maximum(best, dot)
    return first, second


def pieces(shapes: BlockShape, arm: Vec) -> Polygon:
    """The blocks in their own frames, of a star that arm (..., B); arrays (5, ..., B)."""
    tip, notch, out = shapes.rim_start, shapes.rim_end, shapes.rim_out
    other = lambda v: Vec(v.x, -v.y)  # noqa: E731
    inner = notch.turned() * (1.0 / jnp.sqrt(jnp.maximum(notch.dot(notch), 1e-12)))
    none = jax.tree.map(jnp.zeros_like, notch)
    kite = (
        (none, other(notch), tip, notch, notch),
        (other(notch), tip, notch, none, none),
        (other(inner), other(out), out, inner, inner),
    )
    star, broad = is_star(shapes), 2.0 * shapes.rim_end.y
    own = [
        (shapes.corners[k], shapes.corners[k] + shapes.directions[k].turned() * broad,
         shapes.directions[k])
        for k in range(5)
    ]  # fmt: skip
    stacked = [
        _stack([where(star, kite[f][k].out_of(arm), own[k][f]) for k in range(5)]) for f in range(3)
    ]
    like = jnp.zeros_like(arm.x)
    return Polygon(*stacked, shapes.radius + like, is_round(shapes) & (like == 0.0))


def _stack(vectors: list[Vec]) -> Vec:
    return jax.tree.map(lambda *f: jnp.stack(jnp.broadcast_arrays(*f)), *vectors)


class _Side(NamedTuple):
    start: Vec
    end: Vec
    normal: Vec


def _chosen(polygon: Polygon, score: Float[Array, "K ..."]) -> tuple[_Side, Array]:
    """The side with the highest score, and this."""
    side, best = _Side(*(f[0] for f in polygon[:3])), score[0]
    for k in range(1, len(score)):
        better = score[k] > best
        new = (f[k] for f in polygon[:3])
        side = _Side(*(where(better, a, b) for a, b in zip(new, side, strict=True)))
        best = jnp.where(better, score[k], best)
    return side, best


def _separation(polygon: Polygon, other: Polygon) -> Float[Array, "K ..."]:
    """Distances by which the other lies beyond each side; no side of a circle counts."""
    rows = lambda v: Vec(v.x[:, None], v.y[:, None])  # noqa: E731
    reach = rows(polygon.normal).dot(Vec(other.start.x[None], other.start.y[None])).min(axis=1)
    return jnp.where(polygon.round, -jnp.inf, reach - polygon.normal.dot(polygon.start))


def _facing(polygon: Polygon, n: Vec) -> _Side:
    """The side that faces a direction."""
    return _chosen(polygon, polygon.normal.dot(n))[0]


def _direction(a: Polygon, b: Polygon) -> Vec:
    """The unit normal from the first polygons to the second, before they are rounded."""
    mine, beyond = _chosen(a, _separation(a, b))
    theirs, behind = _chosen(b, _separation(b, a))
    own = beyond >= behind
    n = where(own, mine.normal, -theirs.normal)
    # Apart, and not face to face, they are nearest at two corners.
    n, beyond, behind = fence((n, beyond, behind))
    e, f = fence((_facing(a, n), _facing(b, -n)))
    low, high = _span(e, n)
    start, end = _span(f, n)
    after, before = start > high, end < low
    p = where(after, _end_at(e, n, last=True), _end_at(e, n, last=False))
    q = where(after, _end_at(f, n, last=False), _end_at(f, n, last=True))
    circles = a.round & b.round
    corners = circles | ((jnp.maximum(beyond, behind) > 0.0) & (after | before))
    way = where(circles, b.start[0] - a.start[0], q - p)
    return where(corners, way * (1.0 / jnp.sqrt(way.dot(way) + 1e-14)), n)


def _span(side: _Side, n: Vec) -> tuple[Array, Array]:
    """The two ends of a side across a direction, the lower first."""
    ends = side.start.cross(n), side.end.cross(n)
    return jnp.minimum(*ends), jnp.maximum(*ends)


def _end_at(side: _Side, n: Vec, *, last: bool) -> Vec:
    ahead = side.end.cross(n) >= side.start.cross(n)
    return where(ahead == last, side.end, side.start)


def meet(a: Polygon, b: Polygon) -> Meeting:
    """Contacts of the first polygons with the second, relative to one point.

    A gap that is positive is only some such number; the second point of a circle is never there.
    """
    n = fence(_direction(a, b))
    e, f = fence((_facing(a, n), _facing(b, -n)))
    from_e, to_e = e.start.cross(n), e.end.cross(n)
    from_f, to_f = f.start.cross(n), f.end.cross(n)
    width_e, width_f = to_e - from_e, to_f - from_f
    thin = jnp.abs(width_e) < _NARROW, jnp.abs(width_f) < _NARROW
    by_e = jnp.where(thin[0], 0.0, 1.0 / jnp.where(thin[0], 1.0, width_e))
    by_f = jnp.where(thin[1], 0.0, 1.0 / jnp.where(thin[1], 1.0, width_f))
    gaps, points = [], []
    for on_e, on_f in ((to_f, from_e), (from_f, to_e)):
        p = e.start + (e.end - e.start) * jnp.clip((on_e - from_e) * by_e, 0.0, 1.0)
        q = f.start + (f.end - f.start) * jnp.clip((on_f - from_f) * by_f, 0.0, 1.0)
        gaps.append((q - p).dot(n) - a.radius - b.radius)
        points.append(q - n * b.radius)
    gaps[1] = jnp.where(a.round | b.round, FAR, gaps[1])
    return Meeting(n, tuple(gaps), tuple(points))
