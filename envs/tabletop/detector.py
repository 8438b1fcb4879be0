"""Boxes that a detector reports of pictures of the table.

The detector reads which thing each pixel shows, so that it sees no more than a camera: a thing's
box is that of its visible pixels, and a thing that is hidden is not there. Boxes are in units of
half a picture's width, from its middle, y up. Shapes use T for frames, N for things and P for a
picture's pixels along one side.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int8


class Sightings(NamedTuple):
    """Detected boxes of N objects, of one frame or of T."""

    center: Float32[np.ndarray, "*T N 2"]  # middles
    size: Float32[np.ndarray, "*T N 2"]  # widths and heights; above 0 where seen
    seen: Bool[np.ndarray, "*T N"]


def detect(thing: Int8[np.ndarray, "P P"], count: int, *, least: int = 4) -> Sightings:
    """The boxes of the visible pixels of `count` things; one with fewer than `least` is not seen.

    `thing` is the index of what each pixel shows, row 0 on top; below 0 for none.
    """
    pixels = len(thing)
    low, high = np.zeros((2, count, 2), np.float32)
    seen = np.zeros(count, bool)
    for index in range(count):
        mask = thing == index
        if np.count_nonzero(mask) < least:
            continue
        columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
        low[index] = columns[0], pixels - 1 - rows[-1]
        high[index] = columns[-1] + 1, pixels - rows[0]
        seen[index] = True
    scale = np.float32(2 / pixels)
    center = np.where(seen[:, None], (low + high) / 2 * scale - 1, 0).astype(np.float32)
    return Sightings(center, (high - low) * scale, seen)


def stacked(frames: list[Sightings]) -> Sightings:
    """Stacks the frames of one video, in order."""
    return Sightings(*(np.stack(parts) for parts in zip(*frames, strict=True)))


def carried(seen: Sightings) -> Sightings:
    """Fills unseen frames with the last box; frames before the first sighting get the first box.

    Raises:
      ValueError: a thing is seen in no frame.
    """
    never = np.flatnonzero(~seen.seen.any(axis=0))
    if len(never):
        raise ValueError(f"thing {never[0]} is seen in none of {len(seen.seen)} frames")
    times = np.where(seen.seen, np.arange(len(seen.seen))[:, None], -1)
    source = np.maximum.accumulate(times)
    source = np.where(source < 0, seen.seen.argmax(axis=0), source)[..., None]
    center, size = (np.take_along_axis(x, source, axis=0) for x in (seen.center, seen.size))
    return Sightings(center, size, seen.seen)
