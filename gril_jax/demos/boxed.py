"""Demonstrations of a user's own videos, with the boxes beside them and classes of their own.

Videos may differ in size, length and frame rate. The set has one frame rate, by time stamps.
Lengths are in widths of the picture unless half of a picture's width is given in another unit.
"""

import functools
import pathlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gril_jax.errors import DemoError, printable

from . import import_notes
from .demo import Demo, Source, Tracks, trim_static_tail
from .demo_set import DemoSet
from .detected import WORLD
from .formats.fit import doubts, once, require_distinct, require_told_apart, within
from .formats.names import composed
from .formats.record import Box, Film
from .import_notes import Found
from .schema import outcomes
from .tracking.annotated import annotated, by_person, mended_between, step_of
from .tracking.identities import in_order, linked, objects_at_once
from .tracking.mending import Mended, mended
from .vision.timed import nearest, pictures, rate_of, require_a_step, required_rate, steps

WIDTHS, _HALF = "widths of the picture", 0.5
_FASTEST = 10.0  # frames a second: a hand's work needs no more
_SLOWEST = 5.0  # frames a second; in rarer ones whatever moves jumps, and no jump is an error
_RESTING = 0.02  # half extents: what is nearer to its last place has arrived
_DEVIATIONS = 3.0  # of the jitter, which the same takes of boxes that jitter
_MEDIAN = 3  # frames of the median over positions that jitter calls for


class _Plan(NamedTuple):
    """Everything about the videos but their pictures."""

    films: list[Film]
    boxes: list[list[Box]]
    outside: list[int]
    twice: list[int]  # boxes that were there before, left out
    classes: tuple[str, ...]
    counts: dict[str, int]  # objects of each class of the boxes
    nodes: tuple[str, ...]  # class of each object in the set, in the order of the counts
    fps: float


def of_films(
    folder: pathlib.Path,
    films: Sequence[Film],
    boxes: Callable[[Film], list[Box]],
    *,
    robots: Sequence[str],
    half_extent: float | None,
    classes: Sequence[str] | None,
    task: str,
    fps: float | None,
    jitter: float | None,
    smoothing: int | None,
    outcome: str | Mapping[str, str],
    source: str | None,
    progress: Callable[[int], None],
) -> DemoSet:
    """The demonstrations of videos, whose boxes a function gives; options are those of
    `gril_jax.demos.import_videos`.

    Raises:
      DemoError: a damaged video, or boxes that are missing, malformed or do not fit.
    """
    robots = [*map(composed, robots)]
    if not isinstance(outcome, str):
        outcome = {composed(name): kind for name, kind in outcome.items()}
    outcome = outcomes(outcome, [film.name for film in films])
    plan = _planned(folder, [*films], list(map(boxes, films)), classes, fps)
    acting = _acting(folder, plan, robots, classes)
    kinds = np.repeat([*plan.counts], [*plan.counts.values()])
    hands = np.flatnonzero(np.isin(kinds, [*robots])).tolist()
    extent = _HALF if half_extent is None else half_extent
    _require_as_long(films, smoothing)
    every = [_followed(plan, number, hands, jitter, smoothing) for number in range(len(films))]
    noise = max(
        one.jitter / film.width * 2 * extent for (one, *_), film in zip(every, films, strict=True)
    )
    demos, found = [], []
    for number, film in enumerate(films):
        demo, about = _demo(plan, number, every[number], acting, extent, noise)
        demos.append(replace(demo, outcome=outcome[film.name])), found.append(about)
        progress(len(films))
    made = DemoSet(
        tuple(demos), task, plan.classes, float(extent), plan.fps,
        f"{len(films)} videos of {printable(folder.resolve().name)}" if source is None else source,
        robots=tuple(acting), unit=WIDTHS if half_extent is None else WORLD, noise=noise or None,
        smoothing=_MEDIAN if noise else 1,
    )  # fmt: skip
    return replace(made, notes=import_notes.text(made, found, robots))


def _acting(
    folder: pathlib.Path, plan: _Plan, robots: Sequence[str], classes: Sequence[str] | None
) -> list[str]:
    """The set's classes of the robot's classes; a DemoError if no box is of one, or all are."""
    known = plan.counts if classes is None else plan.classes
    for name in robots:
        if name not in known:
            raise DemoError(
                f"{folder}: no box is of the robot's class {name!r:.60}; the classes are "
                f"{', '.join(known)}."
            )
    if {*robots} >= {*plan.counts}:
        raise DemoError(
            f"{folder}: all classes are the robot's, but its own motion is no progress."
        )
    if classes is not None:
        return [*robots]
    kinds = np.repeat([*plan.counts], [*plan.counts.values()])
    return [node for node, kind in zip(plan.nodes, kinds, strict=True) if kind in robots]


def _planned(folder, films, boxes, classes, fps) -> _Plan:
    require_told_apart(films, boxes)
    boxes, twice = zip(*map(once, boxes), strict=True)
    boxes, outside = zip(*map(within, films, boxes), strict=True)
    names = sorted({one.name for each in boxes for one in each})
    require_distinct(folder, names)
    if classes is not None:
        for one in (one for each in boxes for one in each if one.name not in classes):
            raise DemoError(
                f"{one.where}: class {one.name!r} is not one of the task's: {', '.join(classes)}."
            )
    most = [objects_at_once(each) for each in boxes]
    counts = {name: max(each.get(name, 0) for each in most) for name in names}
    rate = rate_of(films, _FASTEST) if fps is None else required_rate(films, fps)
    require_a_step(films, rate)
    nodes = tuple(
        name if number == 1 or classes is not None else f"{name} {k + 1}"
        for name, number in counts.items()
        for k in range(number)
    )
    words = tuple(nodes if classes is None else classes)
    if len({*words}) < len(words):
        both = next(word for word in words if words.count(word) > 1)
        raise DemoError(f"{folder}: {both!r} is a class, and also one of several of a class.")
    return _Plan(films, [*boxes], [*outside], [*twice], words, counts, nodes, round(rate, 6))


def _require_as_long(films: Sequence[Film], smoothing: int | None) -> None:
    """Raises DemoError if boxes are to be smoothed over more frames than a video has."""
    shortest = min(films, key=lambda film: len(film.times))
    if smoothing is not None and smoothing > len(shortest.times):
        raise DemoError(
            f"{shortest.path}: smoothing is {smoothing} frames, but the video has "
            f"{len(shortest.times)}, and must have as many at least."
        )


def _followed(
    plan: _Plan, number: int, hands, jitter, smoothing
) -> tuple[Mended, int, int, np.ndarray, float]:
    """A video's repaired objects, its renewed identities and extra boxes, who was seen when, and
    the frames from one annotated frame to the next."""
    film, parts, renewed, extra = plan.films[number], [], 0, plan.twice[number]
    given_boxes = plan.boxes[number]
    rows = annotated((one.frame for one in given_boxes), len(film.times))
    drawn = all(one.drawn for one in given_boxes)
    for name, count in plan.counts.items():
        own = [one for one in given_boxes if one.name == name]
        one = linked(own, len(film.times), count, sparse=rows is not None or drawn)
        parts.append(one.edges)
        renewed, extra = renewed + one.renewed, extra + one.extra
    edges = np.concatenate(parts, axis=1)
    sighted = ~np.isnan(edges[..., 0])
    given = {"hands": hands, "jitter": jitter, "smoothing": smoothing}
    if rows is None:
        slow = film.fps < _SLOWEST
        if slow and jitter is None:
            given["jitter"] = 0.0  # what bends is the way, not the box
        mend, step = mended(edges, film.fps, strays=not (slow or drawn), **given), 1.0
    else:
        person = by_person(given_boxes)
        mend, step = mended_between(edges, rows, film.fps, drawn=person, **given), step_of(rows)
    order = np.concatenate(
        [at + in_order(mend.edges[:, at : at + n]) for at, n in _places(plan.counts)]
    )
    mend = mend._replace(edges=mend.edges[:, order], seen=mend.seen[:, order])
    return mend, renewed, extra, sighted[:, order], step


def _places(counts: Mapping[str, int]) -> list[tuple[int, int]]:
    """The first object of each class, and their number."""
    ends = np.cumsum([*counts.values()]).tolist()
    return [(end - number, number) for end, number in zip(ends, counts.values(), strict=True)]


def _demo(plan, number, followed, robots, extent, noise) -> tuple[Demo, Found]:
    """A video's demonstration, and what was found in it."""
    film = plan.films[number]
    mend, renewed, extra, sighted, step = followed
    tracks = _tracks(plan, film, mend, extent)
    resting = max(_RESTING * extent, _DEVIATIONS * noise)
    kept = trim_static_tail(tracks, plan.classes, robots=robots, moving=resting)
    at = nearest(film.times, steps(film.times, plan.fps))
    source = Source(at.astype(np.int32), np.asarray(film.times, np.float64)[at])
    whole = Demo(film.name, functools.partial(pictures, film, plan.fps), tracks, source=source)
    kept = max(kept, min(2, len(whole)))
    cut = len(whole) - kept
    shown = sighted.any(axis=0)
    first = np.argmax(sighted[:, shown], axis=0) if shown.any() else np.zeros(1, int)
    names = np.repeat([*plan.counts], [*plan.counts.values()])
    objects = {name: int(shown[names == name].sum()) for name in plan.counts}
    about = Found(
        film.name, kept, cut, objects, float(1 - mend.seen[:, shown].mean()), mend.carried,
        mend.off, renewed, extra, plan.outside[number], float(film.times[int(first.max())]),
        mend.jitter, mend.smoothing, step, _note(plan, number),
    )  # fmt: skip
    return replace(whole, trimmed=cut).during(slice(kept)), about


def _note(plan: _Plan, number: int) -> str | None:
    """A sentence on a video's time stamps and boxes, where there is something to say."""
    film = plan.films[number]
    said = [film.note] if film.note else []
    return "; ".join([*said, *doubts(film, plan.boxes[number])]) or None


def _tracks(plan: _Plan, film: Film, mend: Mended, extent: float) -> Tracks:
    """A video's boxes at the set's steps of time, in its unit."""
    at, times = steps(film.times, plan.fps), np.asarray(film.times)
    flat = mend.edges.reshape(len(times), -1)
    edges = np.stack([np.interp(at, times, side) for side in flat.T], axis=1)
    edges = edges.reshape(len(at), -1, 4)
    index = np.clip(np.searchsorted(times, at + 1e-9) - 1, 0, None)
    seen = mend.seen[index]
    never = ~mend.seen.any(axis=0)
    edges[:, never] = [film.width / 2, film.height / 2, film.width / 2 + 1, film.height / 2 + 1]
    seen[:, never] = False
    seen[0, ~never] |= ~seen[:, ~never].any(axis=0)  # it was, if between two steps
    scale = film.width / (2 * extent) * np.array([1.0, film.aspect])
    low, high = edges[..., :2], edges[..., 2:]
    center = ((low + high) / 2 - [film.width / 2, film.height / 2]) / scale * [1.0, -1.0]
    label = np.array([plan.classes.index(node) for node in plan.nodes])
    return Tracks(
        center.astype(np.float32), ((high - low) / scale).astype(np.float32),
        label.astype(np.int32), seen,
    )  # fmt: skip
