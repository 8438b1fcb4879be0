"""Things that a hand holds in a video, from their first motion to their release.

One frame does not tell: the hand hides a part of what it holds. Over a video a held thing moves as
the hand does, and once the hand leaves it rests. Its box is then whole and fixed to the hand's box,
and grows with that as both come nearer. Boxes are in any unit; T is frames, N objects.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

_AROUND = 2  # frames before and after, between which motions are compared
_ALIKE = 0.05  # diagonals of the hand's box: motions that differ by this much may be the same
_MOST = 4.0  # cost of a frame whose motion is another one
_CHANGE = 6.0  # of taking and of letting go
_STAYS = 0.01  # of what rests while the hand does: it is held until the hand leaves
_NEAR = 0.1  # diagonals of the hand's box: what is nearer is touched
_BEGINS = 6  # frames: so slow is the hand's first motion
_MOVED = 0.15  # the same: what is brought less far is not held
_UNSEEN = 0.02  # the same: what keeps its box while the hand moves so far is a part of no hand
_SMOOTH = 9  # frames of the median of the hand's size
_FREE = 3  # frames without a hand that tell a box
_JUMP = 0.1  # the same: what is next seen so far off was hidden
_TURNED = 1.1  # what is no larger than this along both sides is hidden, and not turned


class Held(NamedTuple):
    """The boxes of a video, with whole ones of what is held."""

    center: Float[np.ndarray, "T N 2"]
    size: Float[np.ndarray, "T N 2"]
    held: Bool[np.ndarray, "T N"]


def with_held(
    center: Float[np.ndarray, "T N 2"], size: Float[np.ndarray, "T N 2"], robots: Sequence[int]
) -> Held:
    """The boxes of a video without gaps, in which `robots` are the parts of one hand.

    The largest part tells where the hand is. A box that was not seen is that of the frame before.
    """
    edges = np.stack([center - size / 2, center + size / 2], axis=2).astype(float)
    held = np.zeros(center.shape[:2], bool)
    if not len(robots):
        return Held(center, size, held)
    areas = np.median(size.prod(axis=-1), axis=0)
    hand = edges[:, max(robots, key=lambda part: areas[part])].copy()
    for part in robots:
        edges[:, part] = _with_hand(edges[:, part], hand, _unseen(edges[:, part], hand))
    for each in sorted({*range(center.shape[1])} - {*robots}):
        unseen = _unseen(edges[:, each], hand)
        box = _with_hand(edges[:, each], hand, unseen & _jumps(edges[:, each], hand, unseen))
        near = np.any([_touch(box, edges[:, part]) for part in robots], axis=0)
        spans = [slice(0), *_spans(box, hand, near), slice(len(box), None)]
        for last, span, following in zip(spans, spans[1:-1], spans[2:], strict=False):
            own = _with_hand(box[span], hand[span], unseen[span])
            rests = slice(last.stop, span.start), slice(span.stop, following.start)
            before, after = (box[rest][~near[rest]] for rest in rests)
            edges[span, each], held[span, each] = _whole(own, hand[span], before, after), True
    low, high = edges[:, :, 0], edges[:, :, 1]
    return Held(((low + high) / 2).astype(np.float32), (high - low).astype(np.float32), held)


def _unseen(box: Float[np.ndarray, "T 2 2"], hand: Float[np.ndarray, "T 2 2"]):
    """True (T,) for frames that repeat a box while the hand moves."""
    same = np.r_[False, (box[1:] == box[:-1]).all(axis=(1, 2))]
    last = np.maximum.accumulate(np.where(same, 0, np.arange(len(box))))
    away = np.linalg.norm((hand - hand[last]).mean(axis=1), axis=-1)
    return same & (away > _UNSEEN * _diagonal(hand))


def _jumps(box: Float[np.ndarray, "T 2 2"], hand: Float[np.ndarray, "T 2 2"], unseen):
    """True (T,) for frames after which a box is next seen far off, and not by the hand's motion."""
    moved, led = (np.diff(x.mean(axis=1), axis=0) for x in (box, hand))
    far = np.min([np.linalg.norm(x, axis=-1) for x in (moved, moved - led)], axis=0)
    far, ends = far > _JUMP * _diagonal(hand), np.zeros(len(box), bool)
    for frame in range(len(box) - 2, -1, -1):
        ends[frame] = ends[frame + 1] if unseen[frame + 1] else far[frame]
    return ends


def _with_hand(
    box: Float[np.ndarray, "T 2 2"], hand: Float[np.ndarray, "T 2 2"], unseen: Bool[np.ndarray, "T"]
) -> Float[np.ndarray, "T 2 2"]:
    """The boxes, which go with the hand in unseen frames."""
    middle, frames = hand.mean(axis=1)[:, None], np.arange(len(box))
    if unseen.all() or not unseen.any():
        return box
    seen = (box - middle)[~unseen].reshape(-1, 4)
    lines = [np.interp(frames, frames[~unseen], side) for side in seen.T]
    return np.where(unseen[:, None, None], np.stack(lines, 1).reshape(box.shape) + middle, box)


def _touch(box: Float[np.ndarray, "T 2 2"], part: Float[np.ndarray, "T 2 2"]):
    """True (T,) where two boxes touch, or nearly."""
    off = _NEAR * _diagonal(part)
    return ((box[:, 0] < part[:, 1] + off) & (box[:, 1] > part[:, 0] - off)).all(axis=-1)


def _diagonal(box: Float[np.ndarray, "T 2 2"]) -> float:
    return float(np.median(np.linalg.norm(box[:, 1] - box[:, 0], axis=-1)))


def _spans(
    box: Float[np.ndarray, "T 2 2"], hand: Float[np.ndarray, "T 2 2"], near: Bool[np.ndarray, "T"]
) -> list[slice]:
    """The frames in which a thing is held, from its first motion on."""
    scale = _diagonal(hand)
    if not near.any() or scale <= 0:
        return []
    middle = hand.mean(axis=1)
    held = _likelier(_other(box, 0.0, scale) + _STAYS, _other(box, _step(middle), scale), near)
    found, last = [], 0
    ends = np.flatnonzero(np.diff(held, prepend=False, append=False)).reshape(-1, 2)
    for begin, end in ends.tolist():
        away = np.linalg.norm(middle[begin:end] - middle[begin], axis=-1) / scale
        if away.max() > _MOVED:
            first = begin + max(int(np.argmax(away > _ALIKE / 2)) - 1, 0)
            off = _ALIKE * scale / 2
            first = _out_of_rest(box, near, last, first, off)
            rests = np.linalg.norm(_step(middle), axis=-1)[max(last, first - _BEGINS) : first] < off
            if rests.any():  # the hand closes before it moves
                first -= int(np.argmax(rests[::-1]))
            found.append(slice(first, end))
            last = end
    return found


def _out_of_rest(box: Float[np.ndarray, "T 2 2"], near, last: int, first: int, off: float) -> int:
    """The frame from which on a box exceeds that at rest: what comes out of another thing has
    edges that rest while it is already held."""
    free = np.flatnonzero(~near[last:first]) + last
    if not len(free):
        return first
    rest = np.median(box[free[-_FREE:]], axis=0)
    beyond = np.maximum(rest[0] - box[:first, 0], box[:first, 1] - rest[1]).max(axis=-1) > off
    inside = np.flatnonzero(~(beyond & near[:first]))
    return int(inside[-1]) + 1 if len(inside) else first


def _step(track: np.ndarray) -> np.ndarray:
    """The way of a track from a few frames before each frame to a few after."""
    at = np.arange(len(track))
    return track[np.minimum(at + _AROUND, len(at) - 1)] - track[np.maximum(at - _AROUND, 0)]


def _other(box: Float[np.ndarray, "T 2 2"], step, scale: float) -> Float[np.ndarray, "T"]:
    """The cost of each frame by how far a box's edges move otherwise than by `step`.

    A mean over edges, of which some may be hidden.
    """
    step = np.broadcast_to(step, box[:, 0].shape)[:, None]
    off = (_step(box) - step) / (_ALIKE * scale)
    return np.minimum(off**2, _MOST).mean(axis=(1, 2))


def _likelier(
    rests: Float[np.ndarray, "T"], moves: Float[np.ndarray, "T"], near: Bool[np.ndarray, "T"]
) -> Bool[np.ndarray, "T"]:
    """True where a thing is held, by least cost over the whole video (Viterbi's algorithm)."""
    costs = np.stack([rests, moves + _MOST * ~near], axis=1)
    change = _CHANGE * (1 - np.eye(2))
    total, came = np.array([0.0, np.inf]), np.zeros((len(rests), 2), int)
    for frame, cost in enumerate(costs):
        ways = total[:, None] + change
        came[frame] = ways.argmin(axis=0)
        total = ways.min(axis=0) + cost
    held, now = np.zeros(len(rests), bool), int(total.argmin())
    for frame in range(len(rests) - 1, -1, -1):
        held[frame] = now == 1
        now = came[frame, now]
    return held


def _whole(
    box: Float[np.ndarray, "T 2 2"], hand: Float[np.ndarray, "T 2 2"],
    before: Float[np.ndarray, "K 2 2"], after: Float[np.ndarray, "L 2 2"],
) -> Float[np.ndarray, "T 2 2"]:  # fmt: skip
    """Whole boxes of what is held, by those of the frames at rest before and after, without a hand.

    What a box lacks of its size is behind the hand.
    """
    sizes = [np.median(x[:, 1] - x[:, 0], axis=0) for x in (before, after) if len(x) >= _FREE]
    if not sizes:
        return box
    first, last = sizes[0], sizes[-1]
    first, last = _larger(first, last), _larger(last, first)
    grown = np.sqrt((hand[:, 1] - hand[:, 0]).prod(axis=-1))
    grown = ndimage.median_filter(grown, _SMOOTH, mode="nearest")
    share = np.linspace(0.0, 1.0, len(box))[:, None]
    size = (first + share * (last - first)) * (grown / grown[0])[:, None]
    beyond = np.maximum([box[:, 0] - hand[:, 0], hand[:, 1] - box[:, 1]], 0) + 1e-6
    lack = np.maximum(size - (box[:, 1] - box[:, 0]), 0) * beyond / beyond.sum(axis=0)
    return np.stack([box[:, 0] - lack[0], box[:, 1] + lack[1]], axis=1)


def _larger(size: Float[np.ndarray, "2"], other: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
    """The other size where this one is smaller in both, so that something hides a part of it."""
    return other if (size < _TURNED * other).all() else size
