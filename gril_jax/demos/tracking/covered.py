"""Boxes that a hand cuts, as whole as they were.

A detector sees what sticks out from under a hand, and its box shrinks to that side: its middle
moves although the object rests. The size that the object has without a hand upon it and the edge
that is free say where it is; of a mere strip they say too little, and it counts as unseen. Shapes
use T for frames and N for objects.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

_SHORT = 0.15  # share of a side that must lack for its box to be cut
_STRIP = 0.35  # share of a side; what is shorter says too little
_DEVIATIONS = 4.0  # of the jitter, which the same takes of a small box
_NEAR = 0.1  # sides that a box may be off the hand's and yet be cut by it
_EVEN = 1e-6  # pixels; where the hand goes beyond no edge, both are as far from the middle
_FREE = 9  # sightings without a hand, before and after, whose sides are the usual ones


def whole(
    edges: Float[np.ndarray, "T N 4"],
    followed: Float[np.ndarray, "T N 4"],
    hands: Sequence[int],
    jitter: float = 0.0,
) -> Float[np.ndarray, "T N 4"]:
    """The boxes, those completed that are cut, and NaN where too little is seen.

    Args:
      edges: x_min, y_min, x_max, y_max, as they were seen.
      followed: the same without gaps, of which the hands' are taken.
      hands: the objects that cover others.
      jitter: of a centre, pixels.
    """
    found = edges.copy()
    for each in (n for n in range(edges.shape[1]) if n not in hands):
        seen = ~np.isnan(edges[:, each, 0])
        if not seen.any():
            continue
        near = {hand: _beside(edges[:, each], followed[:, hand], jitter) for hand in hands}
        under = np.any([seen & False, *near.values()], axis=0)
        sides = edges[:, each, 2:] - edges[:, each, :2]
        free = np.flatnonzero(seen & ~under)
        if not len(free):
            continue
        for frame in np.flatnonzero(under).tolist():
            usual = _usual(sides[free], int(np.searchsorted(free, frame)))
            for hand in (hand for hand in hands if near[hand][frame]):
                one, other = found[frame, each], followed[frame, hand]
                found[frame, each] = _completed(one, other, usual, jitter)
    return found


def _usual(sides: Float[np.ndarray, "F 2"], at: int) -> Float[np.ndarray, "2"]:
    """The sides before and after a place among those that are free, the lesser if they differ: what
    is carried away from the camera is not cut."""
    around = (sides[max(0, at - _FREE) : at], sides[at : at + _FREE])
    return np.min([np.median(part, axis=0) for part in around if len(part)], axis=0)


def _completed(box, hand, usual, jitter) -> Float[np.ndarray, "4"]:
    """A box with its usual sides, longer where the hand is; NaN for a strip."""
    low, high = box[:2], box[2:]
    lack = usual - (high - low)
    if (lack > (1 - _STRIP) * usual).any():
        return np.full(4, np.nan)
    short = lack > np.maximum(_SHORT * usual, _DEVIATIONS * jitter)
    beyond = np.maximum([low - hand[:2], hand[2:] - high], 0)  # of each edge, how far the hand goes
    share = (beyond + _EVEN) / (beyond + _EVEN).sum(axis=0)
    lack = np.where(short, lack, 0.0) * share
    return np.concatenate([low - lack[0], high + lack[1]])


def _beside(
    boxes: Float[np.ndarray, "T 4"], hand: Float[np.ndarray, "T 4"], jitter: float
) -> Bool[np.ndarray, "T"]:
    """True where the hand touches a seen box, or would if their edges were told better."""
    off = _NEAR * np.nanmedian(boxes[:, 2:] - boxes[:, :2], axis=0) + _DEVIATIONS * jitter
    return ((hand[:, :2] - off < boxes[:, 2:]) & (hand[:, 2:] + off > boxes[:, :2])).all(axis=-1)
