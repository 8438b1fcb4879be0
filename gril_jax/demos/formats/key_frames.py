"""Boxes between key frames, of tracks that a tool shows in full and does not write in full."""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .record import Box, Film


class Key(NamedTuple):
    """A frame in which a person drew a box, or from which on the object is out of sight."""

    frame: int
    box: Box | None


def between(film: Film, tracks: Sequence[Sequence[Key]]) -> list[Box]:
    """Boxes on lines between the keys of each track, and after its last one.

    Nothing if the tracks have all frames, or those of a regular step: these are no key frames.
    """
    if _of_steps([key.frame for keys in tracks for key in keys if key.box is not None]):
        return []
    found, last = [], []
    for keys in tracks:
        keys = sorted(keys, key=lambda key: key.frame)
        for one, other in itertools.pairwise(keys):
            if one.box is not None and other.box is not None:
                found += _line(one.box, other.box)
        last += [keys[-1].box] if keys[-1].box is not None else []
    for one in last if found else ():
        found += [one._replace(frame=t) for t in range(one.frame + 1, len(film.times))]
    return found


def _of_steps(frames: Sequence[int]) -> bool:
    """True if the frames are all of one step of several frames."""
    gaps = np.diff(np.unique(frames))
    return bool(len(gaps) > 1 and gaps.min() > 1 and not (gaps % gaps.min()).any())


def _line(one: Box, other: Box) -> list[Box]:
    """The boxes between two of an object, which moves in a line."""
    found = []
    for frame in range(one.frame + 1, other.frame):
        share = (frame - one.frame) / (other.frame - one.frame)
        ends = zip(one.edges, other.edges, strict=True)
        x_min, y_min, x_max, y_max = (a + share * (b - a) for a, b in ends)
        found.append(one._replace(frame=frame, edges=(x_min, y_min, x_max, y_max)))
    return found
