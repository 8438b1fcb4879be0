"""Boxes of every so many frames, as people annotate: one a second, with lines between them.

A tracker's misses come at random, and one object at a time. In an annotation most frames have no
box of any object, and those that have some come at regular gaps. Such boxes are repaired as those
of a video of these frames alone. Shapes use T for frames, S for annotated ones and N for objects.
"""

import itertools
from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from gril_jax.demos.formats.record import Box

from .mending import Mended, mended

_REGULAR = 0.75  # share of the gaps that are one step long, or several
_UNEVEN = 5  # frames of a step that may be one more or less: one a second of 29.97 a second
_FEW = 4  # steps of a gap; with more of them, any gap would be some
_LEAST = 3  # annotated frames from which a step is told
_RATE = 15.0  # sightings a second; rarer ones are believed: hands may be anywhere in the next


def annotated(frames: Iterable[int], total: int) -> Int[np.ndarray, "S"] | None:
    """The frames that were annotated, by those that have boxes; None where all were.

    >>> annotated([0, 10, 20, 40], 45).tolist()
    [0, 10, 20, 40]
    >>> annotated([0, 1, 2, 40], 45) is None
    True
    """
    known = np.unique(np.fromiter(frames, int))
    if len(known) < _LEAST or 2 * len(known) > total + 1:
        return None
    gaps = np.diff(known)
    steps = float(np.median(gaps)), float(gaps.min())
    return known if any(_regular(gaps, step) for step in steps) else None


def _regular(gaps: Int[np.ndarray, "S"], step: float) -> bool:
    """True if most gaps are a step long, or a few."""
    steps = np.maximum(np.round(gaps / step), 1)
    off = np.abs(gaps - steps * step) > (1 if step >= _UNEVEN else 0)
    off |= steps > _FEW
    return bool(step >= 2 and off.mean() <= 1 - _REGULAR)


def mended_between(
    edges: Float[np.ndarray, "T N 4"],
    at: Int[np.ndarray, "S"],
    fps: float,
    *,
    hands: Sequence[int] = (),
    jitter: float | None = None,
    smoothing: int | None = None,
    drawn: bool = False,
) -> Mended:
    """The repaired boxes of all frames, of which those `at` were annotated; see `mended`.

    `drawn` boxes are a person's, all of which are believed."""
    step = step_of(at)
    often = fps / step >= _RATE and not drawn
    if often:  # a detector of every so many frames, which saw nothing in those between
        at = _filled(at, step)
    if jitter is None and not often:
        jitter = 0.0  # what bends is the way, not the box
    if smoothing is not None:
        smoothing = max(1, 2 * round((smoothing / step - 1) / 2) + 1)
    found = mended(
        edges[at], fps / step, hands=hands, jitter=jitter, smoothing=smoothing, strays=often
    )
    frames = np.arange(len(edges))
    flat = found.edges.reshape(len(at), -1)
    lines = [np.interp(frames, at, side) for side in flat.T]
    smoothed = 1 if found.smoothing == 1 else round(found.smoothing * step)
    return found._replace(
        edges=np.stack(lines, axis=1).reshape(edges.shape), seen=_seen(found.seen, at, frames),
        smoothing=smoothed,
    )  # fmt: skip


def by_person(boxes: Sequence[Box]) -> bool:
    """True for boxes that somebody drew, as their tool says, or that have one confidence: those of
    a detector differ."""
    return all(one.drawn for one in boxes) or len({one.confidence for one in boxes}) == 1


def step_of(at: Int[np.ndarray, "S"]) -> float:
    """Frames from one annotated frame to the next, as a rule."""
    return float(np.median(np.diff(at)))


def _filled(at: Int[np.ndarray, "S"], step: float) -> Int[np.ndarray, "R"]:
    """The same frames, and in longer gaps those of the steps between."""
    parts = [
        np.linspace(a, b, max(round((b - a) / step), 1), endpoint=False)
        for a, b in itertools.pairwise(at.tolist())
    ]
    return np.round(np.concatenate([*parts, at[-1:]])).astype(int)


def _seen(
    seen: Bool[np.ndarray, "S N"], at: Int[np.ndarray, "S"], frames: Int[np.ndarray, "T"]
) -> Bool[np.ndarray, "T N"]:
    """True for frames between two sightings, and within a step of the first or the last one."""
    before = np.clip(np.searchsorted(at, frames, side="right") - 1, 0, len(at) - 1)
    after = np.clip(np.searchsorted(at, frames), 0, len(at) - 1)
    near = (frames > at[0] - step_of(at)) & (frames < at[-1] + step_of(at))
    return seen[before] & seen[after] & near[:, None]
