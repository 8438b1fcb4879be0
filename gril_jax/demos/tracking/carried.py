"""Places of an object that a hand hides while it carries it, from where the hand went.

Seen from above, a hand covers what it holds. The object is lost where it lay and found where it
lies then, and in between it moved as the hand did, from some frame to another at which the hand
stood still. Shapes use T for frames; places are centres in pixels.
"""

import itertools
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

_LONGEST = 10.0  # seconds that an object may be hidden for
_MOVED = 0.1  # diagonals of its box: what is found nearer has not been carried
_OFF = 0.35  # diagonals that hand and object may differ by in how far they went
_OFF_HAND = 0.1  # the same in diagonals of the hand's box, which is not told better
_SOONER = (
    0.05  # diagonals that a carry shorter by a second outweighs: a hand rests before and after
)
_RESTING = (
    0.1  # the same of a hand that is slower by a diagonal a second where it takes and lets go
)


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
      hand: its box in each frame of the gap, the last and the next sighting included; NaN where it
        is not known.
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
    """The middle of the hand's box, those of its edges, and its corners: where the picture ends an
    arm, the edges that are left still go with the hand."""
    low, high = hand[:, :2], hand[:, 2:]
    ways = [low, (low + high) / 2, high]
    pairs = sorted(itertools.product((0, 1, 2), repeat=2), key=lambda pair: pair != (1, 1))
    return [np.stack([ways[i][:, 0], ways[j][:, 1]], axis=1) for i, j in pairs]


def _middle(edges: np.ndarray) -> np.ndarray:
    return (edges[..., :2] + edges[..., 2:]) / 2


def _touches(hand: np.ndarray, box: np.ndarray) -> np.ndarray:
    """True where the hand's box has something of another one."""
    return ((hand[..., :2] < box[2:]) & (hand[..., 2:] > box[:2])).all(axis=-1)
