"""Arrangements in which demonstrations end, and a scene's distance from them.

    goal = arrangement(demos, words)                      # once for a set of demonstrations
    cost = disarray(goal, center, size, label, counted, active)   # of any frame

Ends of one job may be many: a line of blocks lies anywhere, heaps are in other corners each time.
What is alike in them is found by comparing last frames with first ones, of four kinds:

    inside, outside  a class is in, or out of, a larger thing that rests, in nearly all ends
    place            ends of a class lie close together in the arena, seen against its journey
    distances        between what moves: of all pairs, or of those whose class names share their
                     first word (a colour), or not, or their last one (a shape), or not; their order
                     statistics, as quantiles

Each has a range over the ends, and a scene within all ranges lacks nothing. A kind of pairs counts
only if first frames are far out of its range, and the more the less ends are; so nobody says that
colours, or shapes, or neither, are what matters. Turned, moved and mirrored arrangements cost the
same, and so do those whose twins have changed places. Nothing of this needs actions or labels.

Shapes use B for demonstrations, T for frames, N for objects, C for classes, K = 5 for the kinds of
pairs and Q for quantile levels; lengths are world units.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from gril_jax.config.reward import LossConfig
from gril_jax.graphs.scene import safe_norm
from gril_jax.types import DemoBatch

_TAIL = 0.1  # share of the ends that a range leaves out on each side
_MOST, _FEW = 0.85, 0.15  # shares of ends that make a rule
_MOVED = 1 / 3  # share of the demonstrations that must move a class
_TIGHT = 0.25  # spread of the ends over the journey, at most, of a place that counts
_FAR = 4.0  # cost of first frames over that of last ones, at least, of distances that count
_KINDS = 5
_LEVELS = 11  # quantile levels of distances
_LEAST = 0.02  # of the cost of first frames: ends whose distances vary less count as these
_FULL, _POWER = 0.9, 3  # as in `final_places`: due near an edge, where tasks draw their line
_REACH = 0.5  # arena units over which the rest is due, at least


class Arrangement(NamedTuple):
    """Common properties of the ends of demonstrations."""

    moves: Bool[Array, "C"]  # demonstrations move it
    always: Bool[Array, "C"]  # nearly all of them do
    container: Bool[Array, "C"]  # it rests, and holds others
    inside: Bool[Array, "C C"]  # class by container
    outside: Bool[Array, "C C"]
    placed: Bool[Array, "C"]
    low: Float[Array, "C 2"]
    high: Float[Array, "C 2"]
    weight: Float[Array, "K"]  # of the kinds of pairs; 0 for those that do not count
    nearest: Float[Array, "K Q"]
    furthest: Float[Array, "K Q"]
    scale: Float[Array, ""]  # mean cost of the first frames
    reference: Int[Array, "C"]  # a class around which its places are interesting
    words: Int[Array, "C 2"]  # first and last word of each class's name


def words_of(classes: Sequence[str]) -> tuple[tuple[int, int], ...]:
    """The first and the last word of each class name, as indices.

    >>> words_of(["robot", "red star", "blue star"])
    ((0, 0), (1, 2), (3, 2))
    """
    known: dict[str, int] = {}
    split = [name.split() or [""] for name in classes]
    index = lambda word: known.setdefault(word, len(known))  # noqa: E731
    return tuple((index(names[0]), index(names[-1])) for names in split)


def arrangement(demos: DemoBatch, words: Sequence[tuple[int, int]]) -> Arrangement:
    """Finds what the last frames of successful demonstrations have in common."""
    first = demos.center[:, 0], demos.size[:, 0]
    at_end = demos.length[:, None, None, None] - 1
    last = tuple(jnp.take_along_axis(x, at_end, axis=1)[:, 0] for x in (demos.center, demos.size))
    counted = demos.present & ~demos.is_robot
    member = (demos.label[:, :, None] == jnp.arange(len(words))) & counted[..., None]  # (B, N, C)
    has = member.any(axis=1)
    moved, container = _moved(demos, member)
    share = moved.sum(axis=0) / jnp.maximum(has.sum(axis=0), 1).astype(jnp.float32)
    goal = _nothing(jnp.asarray(words, jnp.int32))
    goal = goal._replace(moves=share > _MOVED, always=share > _MOST, container=container)
    goal = _bonds(goal, *last, demos.label, member)
    goal = _places(goal, first[0], last[0], member)
    goal = _distances(goal, first, last, demos.label, counted)
    costs = jax.vmap(lambda c, s, label, there: _cost(goal, c, s, label, there, 0.5, 0.5))
    begin = jnp.mean(costs(*first, demos.label, counted))
    around = jnp.argmax(goal.inside | goal.outside, axis=1)
    bound = (goal.inside | goal.outside).any(axis=1)
    reference = jnp.where(bound, around, jnp.argmax(goal.moves))
    return goal._replace(scale=jnp.maximum(begin, 1e-3), reference=reference)


def disarray(
    goal: Arrangement,
    center: Float[Array, "N 2"],
    size: Float[Array, "N 2"],
    label: Int[Array, "N"],
    counted: Bool[Array, "N"],
    active: Bool[Array, "N"],
    *,
    near: Float[Array, ""] | float = LossConfig.near,
    idle_cost: Float[Array, ""] | float = LossConfig.idle_cost,
    touch: Float[Array, ""] | float = LossConfig.touch,
) -> Float[Array, ""]:
    """Cost of a scene relative to the demonstrations' ends: 0 at an end, about 1 at a beginning, at
    most 2.

    Of each object that is out of place, and of each distance out of its range, the share `near` is
    due as soon as it is out by half a box; the rest grows in proportion. Arguments are those of
    `gril_jax.pretraining.final_places.misplacement`.
    """
    cost = _cost(goal, center, size, label, counted, near, idle_cost) / goal.scale
    # Worse than a beginning is at most 2: what lies near the ends is what must be told apart.
    cost = jnp.where(cost > 1.0, 2.0 - 1.0 / jnp.maximum(cost, 1.0), cost)
    due = counted & goal.always[label]
    untouched = (due & ~active).sum() / jnp.maximum(due.sum(), 1).astype(jnp.float32)
    return (1.0 - touch) * cost + touch * untouched


def _nothing(words) -> Arrangement:
    count = len(words)
    none, pairs = jnp.zeros(count, bool), jnp.zeros((count, count), bool)
    places, levels = jnp.zeros((count, 2)), jnp.zeros((_KINDS, _LEVELS))
    return Arrangement(
        none, none, none, pairs, pairs, none, places, places, jnp.zeros(_KINDS), levels, levels,
        jnp.ones(()), jnp.zeros(count, jnp.int32), words,
    )  # fmt: skip


def _moved(demos, member):
    """Classes that move in each demonstration (B, C), and those that rest and hold others (C,)."""
    size = demos.size[:, :1]
    away = safe_norm(demos.center - demos.center[:, :1]).max(axis=1)  # padding repeats a frame
    diagonal = safe_norm(size[:, 0])
    far = ((away > 0.5 * diagonal)[..., None] & member).any(axis=1)
    rests = ~((away > 0.1 * diagonal)[..., None] & member).any(axis=(0, 1))
    apart = jnp.abs(demos.center[:, :, :, None] - demos.center[:, :, None])  # (B, T, N, N)
    smaller = (size[:, :, :, None] < size[:, :, None]).all(axis=-1)
    within = ((apart <= size[:, :, None] / 2).all(axis=-1) & smaller).any(axis=1)
    held = (within & member.any(axis=-1)[..., None]).any(axis=1)  # (B, N)
    holds = (held[..., None] & member).any(axis=(0, 1))
    return far, holds & rests


def _outwardness(container, center, size, label, words):
    """Distance of each centre out of the nearest container of each class, (N, C); negative inside,
    infinite where the scene has none."""
    beyond = (jnp.abs(center[:, None] - center) - size / 2).max(axis=-1)  # (N, N)
    of_class = (label[:, None] == jnp.arange(len(words))) & container  # (N, C)
    return jnp.where(of_class.T[None], beyond[:, None], jnp.inf).min(axis=-1)


def _bonds(goal: Arrangement, center, size, label, member) -> Arrangement:
    out = jax.vmap(lambda *x: _outwardness(goal.container, *x, goal.words))(center, size, label)
    known = jnp.isfinite(out).astype(jnp.float32)  # (B, N, C)
    total = jnp.einsum("bnc,bnr->cr", member.astype(jnp.float32), known)
    inside = jnp.einsum("bnc,bnr->cr", member.astype(jnp.float32), known * (out <= 0))
    share = inside / jnp.maximum(total, 1.0)
    possible = (total > 0) & ~goal.container[:, None]
    return goal._replace(inside=possible & (share > _MOST), outside=possible & (share < _FEW))


def _places(goal: Arrangement, first, last, member) -> Arrangement:
    """Boxes in the arena, of what moves and is in no container."""
    ends = jnp.where(member[..., None], last[:, :, None], jnp.nan)  # (B, N, C, 2)
    low, high = jnp.nanquantile(ends, jnp.array([_TAIL, 1.0 - _TAIL]), axis=(0, 1))
    middle = jnp.nan_to_num(jnp.nanmean(ends, axis=(0, 1)))
    distance = lambda x: jnp.where(member, safe_norm(x[:, :, None] - middle), 0.0)  # noqa: E731
    spread, journey = (distance(x).sum(axis=(0, 1)) for x in (last, first))
    tight = spread < _TIGHT * journey
    placed = goal.moves & tight & ~goal.inside.any(axis=1)
    return goal._replace(placed=placed, low=jnp.nan_to_num(low), high=jnp.nan_to_num(high))


def _distances(goal: Arrangement, first, last, label, counted) -> Arrangement:
    """Ranges of the distances of each kind of pairs, and their weights."""
    each = jax.vmap(lambda center, label, there: _quantiles(goal, center, label, there))
    (ends, count), (begins, _) = (each(x[0], label, counted) for x in (last, first))
    low, high = jnp.quantile(ends, jnp.array([_TAIL, 1.0 - _TAIL]), axis=0)
    goal = goal._replace(nearest=low, furthest=high)
    half = _half_box(goal, last[1][0], label[0], counted[0])
    costs = [jnp.mean(_beyond(goal, x, half, 0.5), axis=(0, 2)) for x in (begins, ends)]
    counts = (costs[0] > _FAR * costs[1]) & (count.min(axis=0) > 0)
    weight = jnp.where(counts, 1.0 / (costs[1] + _LEAST * costs[0] + 1e-6) ** 2, 0.0)
    weight = weight / jnp.maximum(weight.sum(), 1e-6)
    return goal._replace(weight=weight)


def _quantiles(goal: Arrangement, center, label, counted):
    """Quantiles (K, Q) of the distances between what moves, by kind of pairs, and their number."""
    one, other = jnp.triu_indices(len(label), 1)
    distance = safe_norm(center[one] - center[other])
    there = counted & goal.moves[label]
    words = goal.words[label]
    same = (words[one] == words[other]).T  # (2, pairs)
    kinds = jnp.stack([same[0] | True, same[0], ~same[0], same[1], ~same[1]])
    kinds = kinds & there[one] & there[other]
    ordered = jnp.sort(jnp.where(kinds, distance, jnp.inf), axis=1)
    ordered = jnp.where(jnp.isfinite(ordered), ordered, 0.0)
    count = kinds.sum(axis=1)
    last = jnp.maximum(count - 1, 0)[:, None]
    at = jnp.linspace(0.0, 1.0, _LEVELS) * last
    below = jnp.floor(at).astype(jnp.int32)
    above, share = jnp.minimum(below + 1, last), at - below
    lower, upper = (jnp.take_along_axis(ordered, i, axis=1) for i in (below, above))
    return lower + share * (upper - lower), count


def _half_box(goal: Arrangement, size, label, counted):
    """Half the diagonal of the boxes of what moves, on average."""
    there = (counted & goal.moves[label]).astype(size.dtype)
    return jnp.sum(there * safe_norm(size)) / jnp.maximum(jnp.sum(there), 1.0) / 2 + 1e-6


def _beyond(goal: Arrangement, distances, half, near):
    """Cost of distances (..., K, Q) out of their ranges."""
    out = jax.nn.relu(jnp.maximum(goal.nearest - distances, distances - goal.furthest))
    return near * jnp.minimum(out / half, 1.0) + (1.0 - near) * out / _REACH


def _cost(goal: Arrangement, center, size, label, counted, near, idle_cost):
    """The cost of a scene, before it is scaled."""
    half = jnp.maximum(safe_norm(size) / 2, 1e-6)
    moves = counted & goal.moves[label]
    due = jnp.where(moves, 1.0, idle_cost)
    out = _outwardness(goal.container, center, size, label, goal.words)  # (N, C)
    known = jnp.isfinite(out)
    out = jnp.where(known, out, 0.0)
    side = (size.min(axis=1) / 2 + 1e-6)[:, None]
    total = jnp.zeros(())
    for rule, sign in ((goal.inside, 1.0), (goal.outside, -1.0)):
        beyond = sign * out  # of the centre, from where it belongs
        stick = jnp.clip((beyond / side + 1.0) / _FULL, 0.0, 1.0) ** _POWER
        far = jax.nn.relu(beyond) if sign > 0 else jax.nn.relu(beyond + side)
        cost = near * stick + (1.0 - near) * far / _REACH
        cost = jnp.where(rule[label] & known & counted[:, None], cost, 0.0).sum(axis=1)
        total += jnp.sum(due * cost)
    away = safe_norm(center - jnp.clip(center, goal.low[label], goal.high[label]))
    cost = near * jnp.minimum(away / half, 1.0) + (1.0 - near) * away / _REACH
    total += jnp.sum(jnp.where(moves & goal.placed[label], cost, 0.0))
    distances, _ = _quantiles(goal, center, label, counted)
    cost = _beyond(goal, distances, _half_box(goal, size, label, counted), near).mean(axis=1)
    return total + jnp.sum(goal.weight * cost) * jnp.sum(moves) / 2
