"""What a hand does to the boxes of others: it cuts them, and it hides what it carries.

A detector sees only the part of an object that a hand leaves free. The object's size without a hand
and its free edge give its place. A carried object disappears where it lay and reappears where it is
put down; in between it moved as the hand did. T is frames, N objects; edges are in pixels.
"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

_SHORT = 0.15  # share of a side that must lack for its box to be cut
_STRIP = 0.35  # share of a side; what is shorter says too little
_DEVIATIONS = 4.0  # of the jitter, which the same takes of a small box
_NEAR = 0.1  # sides that a box may be off the hand's and yet be cut by it
_EVEN = 1e-6  # pixels; where the hand goes beyond no edge, both are as far from the middle
_FREE = 9  # sightings without a hand, before and after, whose sides are the usual ones
_LONGEST = 10.0  # seconds that an object may be hidden for
_MOVED = 0.1  # diagonals of its box: what is found nearer has not been carried
_OFF = 0.35  # diagonals that hand and object may differ by in how far they went
_OFF_HAND = 0.1  # the same in diagonals of the hand's box, which is not told better
_SOONER = 0.05  # diagonals that a carry shorter by a second outweighs: hands rest before and after
_RESTING = 0.1  # the same of a hand slower by a diagonal a second where it takes and lets go


def uncut(
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
    """The free sides before and after a place; the smaller ones if they differ.

    So an object that is carried away from the camera does not count as cut."""
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


class Carry(NamedTuple):
    """The frames of a gap from which, and up to which, an object goes with the hand."""

    begin: int
    end: int
    off: float  # how much less or more than the hand the object went, in diagonals of its box
    place: Float[np.ndarray, "T 2"]  # the part of the hand's box that goes with the object


def carry(
    hand: Float[np.ndarray, "T 4"],
    before: Float[np.ndarray, "4"],
    after: Float[np.ndarray, "4"],
    fps: float,
) -> Carry | None:
    """The carry that explains how an object came from one box to another while it was not seen.

    None if it lies where it lay, was unseen for more than 10 s, or the hand did not touch both
    places or went another way.

    Args:
      hand: its box in each frame of the gap, the last and the next sighting included. An unknown
        box is NaN.
      before, after: the object's box at these two sightings.
      fps: frames per second.
    """
    if len(hand) > _LONGEST * fps:
        return None
    diagonal = np.linalg.norm(before[2:] - before[:2])
    way = _middle(after) - _middle(before)
    if np.linalg.norm(way) < _MOVED * diagonal or np.isnan(hand).all():
        return None
    frames = np.arange(len(hand))
    seconds = (frames[None] - frames[:, None]) / fps
    possible = _touches(hand, before)[:, None] & _touches(hand, after)[None] & (seconds > 0)
    most = max(_OFF, _OFF_HAND * np.nanmedian(np.linalg.norm(hand[:, 2:] - hand[:, :2], axis=1))
               / diagonal)  # fmt: skip
    found = []
    for place in _parts(hand):
        off = np.linalg.norm(place[None] - place[:, None] - way, axis=-1) / diagonal
        speed = np.linalg.norm(np.gradient(place, axis=0), axis=1) * fps / diagonal
        cost = off + _SOONER * seconds + _RESTING * (speed[:, None] + speed[None])
        cost = np.where(possible & (off < most), cost, np.inf)
        begin, end = np.unravel_index(np.argmin(cost), cost.shape)
        found.append((cost[begin, end], Carry(int(begin), int(end), float(off[begin, end]), place)))
    least, one = min(found, key=lambda pair: pair[0])
    return one if np.isfinite(least) else None


def places(
    hand: Float[np.ndarray, "T 4"],
    before: Float[np.ndarray, "4"],
    after: Float[np.ndarray, "4"],
    found: Carry,
) -> Float[np.ndarray, "T 4"]:
    """The object's boxes in the frames of `carry`."""
    share = np.zeros(len(hand))
    share[found.end :] = 1.0
    moving = slice(found.begin, found.end + 1)
    share[moving] = np.linspace(0.0, 1.0, found.end - found.begin + 1)
    went = np.zeros((len(hand), 2))
    went[moving] = found.place[moving] - found.place[found.begin]
    went[found.end :] = went[found.end]
    rest = (_middle(after) - _middle(before)) - went[found.end]  # what the hand does not explain
    size, grown = before[2:] - before[:2], (after - before)[2:] - (after - before)[:2]
    sizes = size + share[:, None] * grown
    center = _middle(before) + went + share[:, None] * rest
    return np.concatenate([center - sizes / 2, center + sizes / 2], axis=-1)


def _parts(hand: Float[np.ndarray, "T 4"]) -> list[Float[np.ndarray, "T 2"]]:
    """The middle of the hand's box, those of its edges, and its corners.

    Where the picture cuts an arm, the other edges still move with the hand."""
    low, high = hand[:, :2], hand[:, 2:]
    ways = [low, (low + high) / 2, high]
    pairs = sorted(itertools.product((0, 1, 2), repeat=2), key=lambda pair: pair != (1, 1))
    return [np.stack([ways[i][:, 0], ways[j][:, 1]], axis=1) for i, j in pairs]


def _middle(edges: np.ndarray) -> np.ndarray:
    return (edges[..., :2] + edges[..., 2:]) / 2


def _touches(hand: np.ndarray, box: np.ndarray) -> np.ndarray:
    """True where the hand's box has something of another one."""
    return ((hand[..., :2] < box[2:]) & (hand[..., 2:] > box[:2])).all(axis=-1)
