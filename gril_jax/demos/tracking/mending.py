"""Mends the boxes of a video: sightings of something else, gaps, jitter.

Shapes use T for frames and N for objects; edges are x_min, y_min, x_max, y_max in pixels, NaN where
an object is not seen.
"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from numpy.lib.stride_tricks import sliding_window_view
from scipy import ndimage

from .hands import carry, places, uncut

_AROUND = 0.3  # seconds that a sighting is compared with, and that boxes are smoothed over
_OFF = 0.35  # diagonals of the box from the middle of those: a sighting of something else
_DEVIATIONS = 6.0  # of the jitter, which the same takes of a small box
_GROWS = 0.4  # logarithm of the ratio of two sizes that are of two objects
_LONE = 2  # sightings with none around them that may be of something else
_BRIDGED = 1.0  # seconds of a gap that is bridged in a line; in a longer one the last box stays
_STILL = 0.3  # pixels of jitter that need no smoothing

Edges = Float[np.ndarray, "T N 4"]


class Mended(NamedTuple):
    """The boxes of a video without gaps, and what was found."""

    edges: Edges  # finite, but for an object that is never seen
    seen: Bool[np.ndarray, "T N"]  # True where a sighting was believed
    jitter: float  # standard deviation of a centre along one axis, pixels
    off: int  # sightings of something else, such as where two identities were exchanged
    smoothing: int  # frames of the median and of the mean that were taken
    carried: int  # gaps in which an object was hidden by a hand that carried it


def mended(
    edges: Edges,
    fps: float,
    *,
    hands: Sequence[int] = (),
    jitter: float | None = None,
    smoothing: int | None = None,
    strays: bool = True,
) -> Mended:
    """Leaves out stray sightings, closes gaps, and smooths.

    Args:
      edges: as they were read.
      fps: frames per second.
      hands: the objects that carry others, and may hide them.
      jitter: pixels, where it is known; None estimates it.
      smoothing: frames, odd; None takes those of 0.3 s where boxes jitter, else 1.
      strays: False believes all sightings, where they are too rare to tell strays by a jump.
    """
    jitter = jitter_of(edges) if jitter is None else jitter
    window = _odd(_AROUND * fps, least=5)
    bridged = round(_BRIDGED * fps)
    edges = uncut(edges, closed(edges, bridged), hands, jitter)
    off = np.zeros(edges.shape[:2], bool)
    if strays:
        off = stray(edges, window, jitter)
        off |= away(np.where(off[..., None], np.nan, edges), window, jitter)
        off |= lone(np.where(off[..., None], np.nan, edges), window)
    edges = np.where(off[..., None], np.nan, edges)
    seen = ~np.isnan(edges[..., 0])
    if smoothing is None:
        smoothing = _odd(_AROUND * fps, least=3) if jitter > _STILL else 1
    edges, carried = with_carries(edges, _smooth(closed(edges, bridged), smoothing), hands, fps)
    whole = _smooth(closed(edges, bridged), smoothing)
    return Mended(whole, seen, jitter, int(off.sum()), smoothing, carried)


def _smooth(edges: Edges, frames: int) -> Edges:
    if frames == 1:
        return edges
    middle = ndimage.median_filter(edges, (frames, 1, 1), mode="nearest")
    return ndimage.uniform_filter1d(middle, frames, axis=0, mode="nearest")


def with_carries(
    edges: Edges, smoothed: Edges, hands: Sequence[int], fps: float
) -> tuple[Edges, int]:
    """Edges with the gaps filled in which a hand carried an object, and the number of these."""
    found, count = edges.copy(), 0
    for each in (n for n in range(edges.shape[1]) if n not in hands):
        at = np.flatnonzero(~np.isnan(edges[:, each, 0]))
        for a, b in itertools.pairwise(at.tolist()):
            if b == a + 1:
                continue
            gap, ends = slice(a, b + 1), (edges[a, each], edges[b, each])
            ways = [(carry(smoothed[gap, hand], *ends, fps), hand) for hand in hands]
            known = [(way, hand) for way, hand in ways if way is not None]
            if known:
                way, hand = min(known, key=lambda one: one[0].off)
                found[gap, each] = places(smoothed[gap, hand], *ends, way)
                count += 1
    return found, count


def stray(edges: Edges, window: int, jitter: float = 0.0) -> Bool[np.ndarray, "T N"]:
    """Sightings that are far from the median of those around them: of something else."""
    center = (edges[..., :2] + edges[..., 2:]) / 2
    half = window // 2
    padded = np.pad(center, ((half, half), (0, 0), (0, 0)), constant_values=np.nan)
    around = sliding_window_view(padded, window, axis=0)
    # A median of nothing is NaN, and nothing is far from it.
    known = np.where(np.isnan(around).all(axis=-1, keepdims=True), 0.0, around)
    away = np.linalg.norm(center - np.nanmedian(known, axis=-1), axis=-1)
    sides = edges[..., 2:] - edges[..., :2]
    filled = np.where(np.isnan(sides).all(axis=0), 1.0, sides)
    diagonal = np.linalg.norm(np.nanmedian(filled, axis=0), axis=-1)
    return away > np.maximum(_OFF * diagonal, _DEVIATIONS * jitter)


def away(edges: Edges, longest: int, jitter: float = 0.0) -> Bool[np.ndarray, "T N"]:
    """Sightings of something else: at most `longest` frames between a jump and a jump back, as
    where two identities are exchanged briefly. A jump is one of place or of size; the second
    need not lead back where there is a gap of more frames on one side."""
    found = np.zeros(edges.shape[:2], bool)
    for each in range(edges.shape[1]):
        at = np.flatnonzero(~np.isnan(edges[:, each, 0]))
        if len(at) < 3:
            continue
        low, high = edges[at, each, :2], edges[at, each, 2:]
        center, size = (low + high) / 2, np.linalg.norm(high - low, axis=-1)
        far = max(_OFF * float(np.median(size)), _DEVIATIONS * jitter)

        def other(i, j, center=center, size=size, far=far):
            apart = np.linalg.norm(center[i] - center[j], axis=-1) > far
            return apart | (np.abs(np.log(size[i] / size[j])) > _GROWS)

        jumps = np.flatnonzero(other(slice(None, -1), slice(1, None))).tolist()
        for one, two in itertools.pairwise(jumps):
            back = not other(one, two + 1)
            gap = max(at[one + 1] - at[one], at[two + 1] - at[two]) > longest
            if at[two] - at[one + 1] < longest and (back or gap):
                found[at[one + 1 : two + 1], each] = True
    return found


def lone(edges: Edges, window: int) -> Bool[np.ndarray, "T N"]:
    """One or two sightings with none around them, far from the last and from the next one."""
    center = (edges[..., :2] + edges[..., 2:]) / 2
    found = np.zeros(edges.shape[:2], bool)
    for each in range(edges.shape[1]):
        at = np.flatnonzero(~np.isnan(edges[:, each, 0]))
        groups = np.split(at, np.flatnonzero(np.diff(at) > window) + 1)
        sides = edges[at, each, 2:] - edges[at, each, :2]
        far = _OFF * np.linalg.norm(np.median(sides, axis=0)) if len(at) else 0.0
        for number, group in enumerate(groups):
            beside = [one[-1] for one in groups[:number][-1:]]
            beside += [one[0] for one in groups[number + 1 :][:1]]
            away = [np.linalg.norm(center[group[0], each] - center[one, each]) for one in beside]
            found[group, each] = 0 < len(group) <= _LONE and bool(away) and min(away) > far
    return found


def jitter_of(edges: Edges) -> float:
    """Standard deviation of a centre's error along one axis, in pixels.

    It is estimated from the distance of each centre to the line through its neighbours, so steady
    motion adds nothing. 0 where too little is seen.
    """
    center = (edges[..., :2] + edges[..., 2:]) / 2
    bend = center[:-2] - 2 * center[1:-1] + center[2:]
    bend = np.abs(bend[~np.isnan(bend)])
    return float(1.4826 * np.median(bend) / np.sqrt(6)) if len(bend) > 8 else 0.0


def closed(edges: Edges, bridged: int) -> Edges:
    """Edges without gaps: short ones are interpolated, in longer ones the last box stays.

    Before its first sighting an object has the box of that sighting."""
    found = edges.copy()
    frames = np.arange(len(edges))
    for each in range(edges.shape[1]):
        at = np.flatnonzero(~np.isnan(edges[:, each, 0]))
        if not len(at):
            continue
        before = np.maximum(np.searchsorted(at, frames, side="right") - 1, 0)
        after = np.minimum(before + 1, len(at) - 1)
        bridge = (at[after] - at[before] <= bridged + 1) | (frames <= at[0])
        for side in range(4):
            line = np.interp(frames, at, edges[at, each, side])
            found[:, each, side] = np.where(bridge, line, edges[at[before], each, side])
    return found


def _odd(frames: float, *, least: int) -> int:
    return max(least, 2 * round((frames - 1) / 2) + 1)
