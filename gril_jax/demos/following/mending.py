"""Mends the boxes of a film: sightings of something else, gaps, jitter.

Shapes use T for frames and N for objects; edges are x_min, y_min, x_max, y_max in pixels, NaN where
an object is not seen.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from numpy.lib.stride_tricks import sliding_window_view
from scipy import ndimage

_AROUND = 0.3  # seconds that a sighting is compared with, and that boxes are smoothed over
_OFF = 0.35  # diagonals of the box from the middle of those: a sighting of something else
_DEVIATIONS = 6.0  # of the jitter, which the same takes of a small box
_BRIDGED = 1.0  # seconds of a gap that is bridged in a line; in a longer one the last box stays
_STILL = 0.3  # pixels of jitter that need no smoothing

Edges = Float[np.ndarray, "T N 4"]


class Mended(NamedTuple):
    """The boxes of a film without gaps, and what was found."""

    edges: Edges  # finite, but for an object that is never seen
    seen: Bool[np.ndarray, "T N"]  # True where a sighting was believed
    jitter: float  # standard deviation of a centre along one axis, pixels
    off: int  # sightings of something else, such as where two identities were exchanged
    smoothing: int  # frames of the median and of the mean that were taken


def mended(
    edges: Edges, fps: float, *, jitter: float | None = None, smoothing: int | None = None
) -> Mended:
    """Leaves out stray sightings, closes gaps, and smooths.

    Args:
      edges: as they were read.
      fps: frames per second.
      jitter: pixels, where it is known; None estimates it.
      smoothing: frames, odd; None takes those of 0.3 s where boxes jitter, else 1.
    """
    jitter = jitter_of(edges) if jitter is None else jitter
    off = stray(edges, _odd(_AROUND * fps, least=5), jitter)
    edges = np.where(off[..., None], np.nan, edges)
    seen = ~np.isnan(edges[..., 0])
    if smoothing is None:
        smoothing = _odd(_AROUND * fps, least=3) if jitter > _STILL else 1
    whole = closed(edges, round(_BRIDGED * fps))
    if smoothing > 1:
        middle = ndimage.median_filter(whole, (smoothing, 1, 1), mode="nearest")
        whole = ndimage.uniform_filter1d(middle, smoothing, axis=0, mode="nearest")
    return Mended(whole, seen, jitter, int(off.sum()), smoothing)


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


def jitter_of(edges: Edges) -> float:
    """Standard deviation of a centre's error along one axis, pixels, by how far each centre is from
    the line through its neighbours: what moves steadily adds nothing. 0 where too little is seen.
    """
    center = (edges[..., :2] + edges[..., 2:]) / 2
    bend = center[:-2] - 2 * center[1:-1] + center[2:]
    bend = np.abs(bend[~np.isnan(bend)])
    return float(1.4826 * np.median(bend) / np.sqrt(6)) if len(bend) > 8 else 0.0


def closed(edges: Edges, bridged: int) -> Edges:
    """Edges without gaps: short ones are bridged in a line, in longer ones the last box stays, and
    before its first sighting an object is where that is."""
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
