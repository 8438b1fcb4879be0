"""Sentences on an import: what was found in each video, and what was repaired."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .demo import MARGIN
from .demo_set import DemoSet

_MANY = 0.3  # share of the boxes that may be missing without a sentence on it


class Found(NamedTuple):
    """The findings of an import in one video, and what it repaired."""

    name: str
    frames: int  # kept
    trimmed: int  # cut from the static end
    objects: dict[str, int]  # classes to how many of their objects the video shows
    missing: float  # share of (frame, object) pairs without a sighting
    carried: int  # times that an object was hidden by the robot or hand that carried it
    stray: int  # sightings that were of something else, as where identities were exchanged
    renewed: int  # times that a tracker went on with another identity
    extra: int  # second sightings of an object, left out
    outside: int  # boxes outside of the picture, left out
    late: float  # seconds until the last object is first seen
    jitter: float  # of centres along one axis, pixels of the video
    smoothing: int  # frames of the video that boxes were smoothed over
    step: float = 1.0  # frames from one with boxes to the next, where they come at regular gaps
    note: str | None = None  # on its time stamps


def text(made: DemoSet, films: Sequence[Found], robots: Sequence[str]) -> str:
    """Sentences on the videos together, an empty line, and a line for each video."""
    return "\n".join([*_together(made, films, robots), "", *map(_line, films), ""])


def _together(made: DemoSet, films: Sequence[Found], robots: Sequence[str]) -> list[str]:
    """What was found in all videos, what was missing or wrong in them, and what is doubtful."""
    classes = dict.fromkeys(name for film in films for name in film.objects)
    most = {name: max(film.objects[name] for film in films) for name in classes}
    shown = ", ".join(f"{n} x {name}" if n > 1 else name for name, n in most.items())
    acting = f"of these the robot or person is {', '.join(robots)}" if robots else "none acts"
    total = lambda name: sum(getattr(film, name) for film in films)  # noqa: E731
    missing = np.mean([film.missing for film in films])
    mended = [f"{missing:.0%} of the boxes are missing and were filled in"]
    if count := total("carried"):
        mended.append(f"{count} times something was carried out of sight, and goes with the hand")
    if count := total("stray"):
        mended.append(f"{count} were of another object and left out")
    if count := total("renewed"):
        mended.append(f"{count} changes of a tracker's identity were followed")
    if count := total("extra"):
        mended.append(f"{count} were second sightings of an object and left out")
    lines = [
        f"{len(films)} videos, {made.fps:g} frames a second; objects: {shown}; {acting}",
        f"lengths are in {made.unit}; a frame shows {made.half_extent:g} to each side of its "
        "middle",
        "; ".join(mended),
    ]
    if jitter := max(film.jitter for film in films):
        lines.append(
            f"boxes jitter by {jitter:.1f} pixels: this is in the set as noise {made.noise:.4f} "
            f"({made.unit}), so that resting objects do not count as moved (jitter sets it)"
        )
    if rare := [film for film in films if film.step > 1]:
        lines.append(
            f"{', '.join(film.name for film in rare)}: boxes are those of one frame in "
            f"{rare[0].step:.0f}; between these they lie on lines"
        )
    if several := [name for name, n in most.items() if n > 1]:
        lines.append(
            f"there are several of {', '.join(several)}: in each video {several[0]} 1 is the first "
            "that moves, and those that stay where they are follow from left to right"
        )
    if not robots:
        lines.append("no class is the robot's or the person's: name it as the robot if one is")
    lines += [f"{film.name}: {film.note}" for film in films if film.note]
    for film in films:
        if lacks := [name for name, count in film.objects.items() if not count]:
            lines.append(f"doubtful: {film.name} never shows {', '.join(lacks)}")
        if film.missing > _MANY:
            lines.append(f"doubtful: {film.name} lacks {film.missing:.0%} of its boxes")
        if film.trimmed and film.frames <= 1 + MARGIN:
            beside = f" but {' and '.join(robots)}" if robots else ""
            lines.append(
                f"doubtful: in {film.name} nothing{beside} moves, so only its first "
                f"{film.frames} frames are kept"
            )
    return lines


def _line(film: Found) -> str:
    objects = ", ".join(f"{count} x {name}" for name, count in film.objects.items())
    return (
        f"{film.name}: {film.frames} frames kept and {film.trimmed} cut from its resting end; "
        f"{objects}; {film.missing:.1%} of the boxes missing, all objects seen from "
        f"{film.late:.1f} s; {film.carried} times carried out of sight; {film.stray} stray, "
        f"{film.extra} second and {film.outside} outside boxes left out; {film.renewed} "
        f"identities renewed; jitter {film.jitter:.2f} pixels, "
        f"smoothed over {film.smoothing} frames"
    )
