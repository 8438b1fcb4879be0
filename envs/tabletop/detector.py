"""What a detector reports of pictures of the table, and how a real one errs.

The detector reads which thing each pixel shows, so that it sees no more than a camera: a thing's
box is that of its visible pixels, and a thing that is hidden is not there. Boxes are in units of
half a picture's width, from its middle, y up. Shapes use T for frames, N for things and P for a
picture's pixels along one side.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int8

__all__ = ["EXACT", "Noise", "Sightings", "carried", "detect", "disturbed", "stacked"]


class Sightings(NamedTuple):
    """Boxes of N things, of one frame or of T."""

    center: Float32[np.ndarray, "*T N 2"]  # middles
    size: Float32[np.ndarray, "*T N 2"]  # widths and heights; above 0 where seen
    seen: Bool[np.ndarray, "*T N"]


class Noise(NamedTuple):
    """How a detector errs."""

    jitter: float = 0.0  # standard deviation of each edge of a box, pixels
    dropout: float = 0.0  # chance that a thing is missed in a frame
    switch: float = 0.0  # chance, frame by frame, that two twins change names for good


EXACT = Noise()


def detect(thing: Int8[np.ndarray, "P P"], count: int, *, least: int = 4) -> Sightings:
    """Boxes of the visible pixels.

    Args:
      thing: index of the thing that each pixel shows, row 0 on top; below 0 for none.
      count: of things.
      least: pixels; a thing that shows fewer is not seen.
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
    """Frames of one video, in order."""
    return Sightings(*(np.stack(parts) for parts in zip(*frames, strict=True)))


def disturbed(
    exact: Sightings,
    noise: Noise,
    rng: np.random.Generator,
    *,
    pixels: int,
    twins: tuple[tuple[int, int], ...] = (),
) -> Sightings:
    """The same video as a worse detector would report it.

    Args:
      exact: T frames.
      noise: how much worse.
      rng: consumed.
      pixels: of a picture's side, the unit of the jitter.
      twins: pairs of things that look alike.

    Raises:
      ValueError: a number is out of range.
    """
    for name, value in noise._asdict().items():
        if not 0 <= value < (1 if name != "jitter" else np.inf):
            limit = "at least 0" if name == "jitter" else "from 0 to below 1"
            raise ValueError(f"noise.{name} is {value}, but must be {limit}")
    low, high = exact.center - exact.size / 2, exact.center + exact.size / 2
    pixel = 2 / pixels
    for edge in (low, high):
        edge += rng.normal(0, noise.jitter * pixel, edge.shape)
    center, size = (low + high) / 2, np.maximum(high - low, pixel)
    seen = exact.seen & (rng.random(exact.seen.shape) >= noise.dropout)
    names = np.tile(np.arange(exact.seen.shape[1]), (len(seen), 1))
    for a, b in twins:
        changed = np.cumsum(rng.random(len(seen)) < noise.switch) % 2 == 1
        names[changed, a], names[changed, b] = b, a
    center, size = (np.take_along_axis(x, names[..., None], axis=1) for x in (center, size))
    return Sightings(center, size, np.take_along_axis(seen, names, axis=1))


def carried(seen: Sightings) -> Sightings:
    """A thing that is not seen keeps its last box; before its first sighting, that one.

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
