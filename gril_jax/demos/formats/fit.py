"""Which boxes of a file count: those of one video alone, each once, and within the picture."""

import math
from collections.abc import Sequence
from pathlib import Path

from gril_jax.errors import DemoError

from .names import folded
from .record import Box, Film, alike

_SHARE = 2.0  # pixels; a share of the picture is 1 at most, or more for a box beyond it
_COPY = 1 / 3  # of both sides of the picture: boxes within it may be of a smaller copy
_BEYOND = 1.1  # sides of the picture, which a tracker's guess may reach to
_OFTEN = 0.2  # share of the boxes that may reach further
_COMPARED = 200  # boxes of a class in a frame: no video shows more


def require_told_apart(films: Sequence[Film], boxes: Sequence[list[Box]]) -> None:
    """Raises DemoError if a line of a file is a box of two videos."""
    owner: dict[str, Film] = {}
    for film, each in zip(films, boxes, strict=True):
        for where in {one.where for one in each}:
            if owner.setdefault(where, film) is not film:
                raise DemoError(
                    f"{where}: this box is taken for one of {owner[where].name} and of "
                    f"{film.name}, since the file does not say which of its boxes are of which "
                    "video; give each video a file of its own."
                )


def once(boxes: list[Box]) -> tuple[list[Box], int]:
    """The boxes, of which each counts once where it is written twice, and how many were left out.

    A detector that runs a second time may append its boxes to those of the first."""
    kept: dict[tuple[int, str, str | None], list[Box]] = {}
    for one in boxes:
        same = kept.setdefault((one.frame, one.name, one.track), [])
        if not any(alike(one, other) for other in same[-_COMPARED:]):
            same.append(one)
    found = sorted((one for same in kept.values() for one in same), key=lambda one: one.frame)
    return found, len(boxes) - len(found)


def require_distinct(folder: Path, names: Sequence[str]) -> None:
    """Raises DemoError if two classes differ in capitals alone."""
    known: dict[str, str] = {}
    for name in names:
        if known.setdefault(folded(name), name) != name:
            raise DemoError(
                f"{folder}: the classes {known[folded(name)]!r} and {name!r} differ in capitals "
                "alone; write one of them in all files."
            )


def doubts(film: Film, boxes: list[Box]) -> list[str]:
    """What may be wrong with boxes, but need not be."""
    said = []
    right = max((one.edges[2] for one in boxes), default=film.width)
    low = max((one.edges[3] for one in boxes), default=film.height)
    if right <= _COPY * film.width and low <= _COPY * film.height:
        said.append(
            f"all boxes lie in the upper left {right:.0f} x {low:.0f} of {film.width} x "
            f"{film.height} pixels, as if they were of a smaller copy of the video"
        )
    beyond = [
        one
        for one in boxes
        if one.edges[2] > _BEYOND * film.width or one.edges[3] > _BEYOND * film.height
    ]
    if boxes and len(beyond) > _OFTEN * len(boxes):
        said.append(
            f"{len(beyond) / len(boxes):.0%} of the boxes reach far beyond the right or lower edge "
            "of the picture, as if a corner were in place of their width and height"
        )
    frames = {one.frame for one in boxes}
    table = any(".csv, line" in one.where.lower() for one in boxes[:1])  # which counts from 0
    if table and min(frames) == 1 and 2 * len(frames) > len(film.times):
        said.append(
            "frames count from 0, but no box is in frame 0: if they were counted from 1, all boxes "
            "are one frame late"
        )
    return said


def within(film: Film, boxes: list[Box]) -> tuple[list[Box], int]:
    """The boxes that touch the picture, and the number of the others.

    Raises DemoError if the others are so many that the boxes must be of another video."""

    def inside(one: Box) -> bool:
        low_x, low_y, high_x, high_y = one.edges
        return low_x < film.width and low_y < film.height and high_x > 0 and high_y > 0

    most = max((max(one.edges) for one in boxes), default=math.inf)
    if most <= _SHARE:
        raise DemoError(
            f"{boxes[0].where}: all edges are at most {max(most, 1):.3g}, so the boxes seem to be "
            f"shares of the picture; they must be pixels, and {film.path.name} is {film.width} x "
            f"{film.height}."
        )
    kept = [one for one in boxes if inside(one)]
    if 10 * (len(boxes) - len(kept)) > len(boxes):
        first = next(one for one in boxes if not inside(one))
        edges = ", ".join(f"{edge:g}" for edge in first.edges)
        raise DemoError(
            f"{first.where}: the box {edges} lies outside of the picture, as do "
            f"{len(boxes) - len(kept)} of {len(boxes)}; {film.path.name} is {film.width} x "
            f"{film.height} pixels, so the boxes seem to be of a video of another size."
        )
    return kept, len(boxes) - len(kept)
