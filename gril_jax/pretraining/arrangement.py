"""Arrangements in which demonstrations end, and a scene's distance from them.

    goal = arrangement(demos, words)                      # once for a set of demonstrations
    cost = disarray(goal, center, size, label, counted, active)   # of any frame

A task may end in many ways: a line of blocks lies anywhere, clusters are in other corners each
time. Their common features are found by comparing last frames with others. They are of three kinds:

    bonds            what is in a larger thing that rests, or out of it (`containers`)
    place            ends of a class lie close together in the arena, seen against its journey
    distances        between what moves and belongs in nothing: statistics of pairs
                     (`gril_jax.graphs.pair_statistics`)

Each has a range over the ends, and a scene within all ranges costs nothing. The fewer other scenes
are in a statistic's range, the more it counts. So nobody has to say whether colours or
shapes matter. Turned, moved and mirrored arrangements cost the same, and so do those in which
objects of one class have changed places. An object that no demonstration moves costs a little once
it has been moved: a thing that has taken another one's place looks the same. No actions or labels
are needed.

Shapes use B for demonstrations, T for frames, N for objects and C for classes; lengths are world
units.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from gril_jax.config.reward import LossConfig
from gril_jax.graphs.pair_statistics import pair_statistics
from gril_jax.graphs.scene import safe_norm
from gril_jax.types import DemoBatch

from . import containers, pair_distances

_TAIL = 0.1  # share of the ends that a range leaves out on each side
_MOST = 0.85  # share of the demonstrations that must move a class that always moves
_MOVED = 1 / 3  # share of the demonstrations that must move a class
_EXCHANGES = 64  # ends with things in each other's places that are drawn from each end
_TIGHT = 0.25  # spread of the ends over the journey, at most, of a place that counts
_STIRRED, _AT_MOST = 0.1, 2  # cost of a thing that no demonstration moves, and how many count
_REACH = 0.5  # arena units over which the rest of the cost grows, at least


class Arrangement(NamedTuple):
    """Common properties of the ends of demonstrations."""

    moves: Bool[Array, "C"]  # demonstrations move it
    always: Bool[Array, "C"]  # nearly all of them do
    rests: Bool[Array, "C"]  # none of them does, and it holds nothing
    bonds: containers.Bonds
    placed: Bool[Array, "C"]
    low: Float[Array, "C 2"]
    high: Float[Array, "C 2"]
    distances: pair_distances.Ranges
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
    moved, rests, container = _moved(demos, member)
    share = moved.sum(axis=0) / jnp.maximum(has.sum(axis=0), 1).astype(jnp.float32)
    goal = _nothing(jnp.asarray(words, jnp.int32))
    goal = goal._replace(
        moves=share > _MOVED, always=share > _MOST, rests=rests & ~container & has.any(axis=0),
        bonds=containers.found(container, *last, demos.label, member),
    )  # fmt: skip
    goal = _places(goal, first[0], last[0], member)
    goal = goal._replace(distances=_distances(goal, demos, last[0], counted))
    costs = jax.vmap(lambda c, s, label, there: _cost(goal, c, s, label, there, 0.5, 0.5))
    begin = jnp.mean(costs(*first, demos.label, counted))
    bound = goal.bonds.inside | goal.bonds.outside
    reference = jnp.where(bound.any(axis=1), jnp.argmax(bound, axis=1), jnp.argmax(goal.moves))
    return goal._replace(scale=jnp.maximum(begin, 1e-3), reference=reference)


def disarray(
    goal: Arrangement,
    center: Float[Array, "N 2"],
    size: Float[Array, "N 2"],
    label: Int[Array, "N"],
    counted: Bool[Array, "N"],
    active: Bool[Array, "N"],
    *,
    near_cost_fraction: Float[Array, ""] | float = LossConfig.near_cost_fraction,
    intrusion_weight: Float[Array, ""] | float = LossConfig.intrusion_weight,
    touch: Float[Array, ""] | float = LossConfig.touch,
) -> Float[Array, ""]:
    """Cost of a scene relative to the demonstrations' ends: 0 at an end, about 1 at a beginning, at
    most 2.

    The fraction `near_cost_fraction` of an object's cost applies as soon as it is out of place by
    half a box. For a statistic of pairs it applies once its value is clearly out of its range. The
    rest grows in proportion. Arguments are those of `final_places.misplacement`.
    """
    weights = near_cost_fraction, intrusion_weight
    cost = _cost(goal, center, size, label, counted, *weights) / goal.scale
    # Worse than a beginning is at most 2: what lies near the ends is what must be told apart.
    cost = jnp.where(cost > 1.0, 2.0 - 1.0 / jnp.maximum(cost, 1.0), cost)
    due = counted & goal.always[label]
    untouched = (due & ~active).sum() / jnp.maximum(due.sum(), 1).astype(jnp.float32)
    stirred = jnp.minimum((counted & goal.rests[label] & active).sum(), _AT_MOST)
    return (1.0 - touch) * cost + touch * untouched + _STIRRED * stirred


def _nothing(words) -> Arrangement:
    count = len(words)
    none, places = jnp.zeros(count, bool), jnp.zeros((count, 2))
    return Arrangement(
        none, none, none, containers.nothing(count), none, places, places,
        pair_distances.nothing(), jnp.ones(()), jnp.zeros(count, jnp.int32), words,
    )  # fmt: skip


def _moved(demos, member):
    """Classes that move in each demonstration (B, C), that never do (C,), and that hold others."""
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
    return far, rests, holds & rests


def _places(goal: Arrangement, first, last, member) -> Arrangement:
    """Boxes in the arena, of what moves and is in no container."""
    ends = jnp.where(member[..., None], last[:, :, None], jnp.nan)  # (B, N, C, 2)
    low, high = jnp.nanquantile(ends, jnp.array([_TAIL, 1.0 - _TAIL]), axis=(0, 1))
    middle = jnp.nan_to_num(jnp.nanmean(ends, axis=(0, 1)))
    distance = lambda x: jnp.where(member, safe_norm(x[:, :, None] - middle), 0.0)  # noqa: E731
    spread, journey = (distance(x).sum(axis=(0, 1)) for x in (last, first))
    tight = spread < _TIGHT * journey
    placed = goal.moves & tight & ~goal.bonds.inside.any(axis=1)
    return goal._replace(placed=placed, low=jnp.nan_to_num(low), high=jnp.nan_to_num(high))


def _distances(goal: Arrangement, demos, last, counted) -> pair_distances.Ranges:
    """The ranges of the ends' distances, seen against those of other scenes."""
    of_one = lambda center, label, there: _pairs(goal, center, label, there)  # noqa: E731
    ends, count = jax.vmap(of_one)(last, demos.label, counted)
    of_film = lambda film: jax.vmap(lambda c: of_one(c, film[1], film[2])[0])(film[0])  # noqa: E731
    frames = jax.lax.map(of_film, (demos.center, demos.label, counted))
    real = jnp.arange(demos.center.shape[1]) < demos.length[:, None]
    share = real / demos.length[:, None] / len(demos.length)
    exchanged = _exchanged(goal, last, demos.label, counted)
    return pair_distances.learned(ends, frames, share, exchanged, count.min(axis=0) > 0)


def _exchanged(goal: Arrangement, last, label, counted) -> Float[Array, "B M K Q"]:
    """Statistics of last frames in which what moves has changed places, in M ways drawn once."""

    def one(key, center, label, there):
        free = there & goal.moves[label]
        order = jnp.arange(len(label), dtype=jnp.float32)
        drawn = jax.random.uniform(key, label.shape)
        # The free ones come first in both, in their own order and in one that is drawn.
        before, after = (jnp.argsort(jnp.where(free, x, 2.0 + order)) for x in (drawn, order / 1e6))
        return _pairs(goal, center, label.at[after].set(label[before]), there)[0]

    keys = jax.random.split(jax.random.key(0), (len(last), _EXCHANGES))
    many = jax.vmap(jax.vmap(one, (0, None, None, None)))
    return many(keys, last, label, counted)


def _pairs(goal: Arrangement, center, label, counted):
    """Statistics of the pairs of what moves and belongs in nothing, and the number of pairs."""
    free = counted & goal.moves[label] & ~goal.bonds.inside.any(axis=1)[label]
    return pair_statistics(center, goal.words[label], free)


def _half_box(goal: Arrangement, size, label, counted):
    """Half the diagonal of the boxes of what moves, on average."""
    there = (counted & goal.moves[label]).astype(size.dtype)
    return jnp.sum(there * safe_norm(size)) / jnp.maximum(jnp.sum(there), 1.0) / 2 + 1e-6


def _cost(goal: Arrangement, center, size, label, counted, near_cost_fraction, intrusion_weight):
    """The cost of a scene, before it is scaled."""
    half = jnp.maximum(safe_norm(size) / 2, 1e-6)
    moves = counted & goal.moves[label]
    due = jnp.where(moves, 1.0, intrusion_weight)
    total = containers.lacking(goal.bonds, center, size, label, counted, due, near_cost_fraction)
    away = safe_norm(center - jnp.clip(center, goal.low[label], goal.high[label]))
    cost = (
        near_cost_fraction * jnp.minimum(away / half, 1.0)
        + (1.0 - near_cost_fraction) * away / _REACH
    )
    total += jnp.sum(jnp.where(moves & goal.placed[label], cost, 0.0))
    pairs, _ = _pairs(goal, center, label, counted)
    cost = pair_distances.beyond(
        goal.distances, pairs, _half_box(goal, size, label, counted), near_cost_fraction
    )
    return total + cost * jnp.sum(moves) / 2
