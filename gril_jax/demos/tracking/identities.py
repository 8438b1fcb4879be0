"""Boxes of a film as objects: which box of a frame is which object of a class.

Objects of one class are told apart by where they are from frame to frame, and by their tracker's
identity while that lasts; a detector's boxes have none, and get one (`tracked`). Shapes use T for
frames and K for the objects of one class.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment

from gril_jax.demos.formats.record import Box

_OFTEN = 0.2  # share of the frames that show a class: as many objects as they show are there
_FAR = 2.0  # diagonals of the box: a box further from every known object is another one
_MOVES = 0.5  # diagonals
_SAME = 1.0  # diagonals that an equal identity outweighs


class Linked(NamedTuple):
    """The objects of one class in a film."""

    edges: Float[np.ndarray, "T K 4"]  # x_min, y_min, x_max, y_max; NaN where it is not seen
    renewed: int  # times that a tracker went on with another identity
    extra: int  # boxes that are of no object: second sightings of one


def objects_at_once(boxes: Sequence[Box]) -> dict[str, int]:
    """The number of objects of each class that a film shows at once, in a fifth of the frames that
    show any.

    >>> row = (0.0, 0.0, 1.0, 1.0)
    >>> objects_at_once([Box(0, "cup", row), Box(0, "cup", row), Box(1, "cup", row)])
    {'cup': 2}
    """
    frames: dict[str, Counter[int]] = {}
    for one in boxes:
        frames.setdefault(one.name, Counter())[one.frame] += 1
    found = {}
    for name, counts in frames.items():
        numbers = sorted(counts.values(), reverse=True)
        found[name] = numbers[int(_OFTEN * len(numbers))]
    return found


def linked(boxes: Sequence[Box], frames: int, count: int) -> Linked:
    """The boxes of one class as `count` objects, in order of their first sighting."""
    edges = np.full((frames, count, 4), np.nan)
    place, known = np.zeros((count, 2)), 0  # of the objects found so far
    identity: list[str | None] = [None] * count
    renewed = extra = 0
    for frame, now in sorted(_by_frame(boxes).items()):
        corners = np.array([one.edges for one in now])
        center = (corners[:, :2] + corners[:, 2:]) / 2
        diagonal = np.linalg.norm(corners[:, 2:] - corners[:, :2], axis=1)
        same = np.array([[one.track is not None and one.track == identity[k] for k in range(known)]
                         for one in now], bool).reshape(len(now), known)  # fmt: skip
        apart = np.linalg.norm(center[:, None] - place[None, :known], axis=-1) / diagonal[:, None]
        cost = apart - _SAME * same
        rows, columns = linear_sum_assignment(cost) if known else (np.array([], int),) * 2
        free = {*range(len(now))}
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
            if known < count and not same[row, column] and apart[row, column] > _FAR:
                continue  # an object that has not been seen before
            free.discard(row)
            renewed += identity[column] not in (None, now[row].track)
            edges[frame, column], place[column] = corners[row], center[row]
            identity[column] = now[row].track
        for row in sorted(free, key=lambda row: -now[row].confidence):
            if known == count:
                extra += 1
                continue
            edges[frame, known], place[known] = corners[row], center[row]
            identity[known] = now[row].track
            known += 1
    return Linked(edges, renewed, extra)


def in_order(edges: Float[np.ndarray, "T K 4"]) -> Int[np.ndarray, "K"]:
    """The objects of one class, the same way round in every film: by when they first move, and
    those that do not from left to right; at the end those that are never seen.

    `edges` are mended. An object moves once it is half of its box's diagonal from where it began.
    """
    center = (edges[..., :2] + edges[..., 2:]) / 2
    diagonal = np.linalg.norm(edges[0, :, 2:] - edges[0, :, :2], axis=-1)
    moved = np.linalg.norm(center - center[0], axis=-1) > _MOVES * diagonal
    first = np.where(moved.any(axis=0), moved.argmax(axis=0), len(edges))
    never = np.isnan(center[0, :, 0])
    return np.lexsort((np.nan_to_num(center[0, :, 0]), first, never))


def _by_frame(boxes: Iterable[Box]) -> dict[int, list[Box]]:
    """The boxes of each frame that shows something."""
    frames: dict[int, list[Box]] = {}
    for one in boxes:
        frames.setdefault(one.frame, []).append(one)
    return frames


_PATIENCE = 1.0  # seconds that an object may go unseen before a new one begins
_LEAST = -1.0  # generalised overlap of a match: boxes apart by their own width have about this
_JUMP = 0.05  # deviation of a box's speed from a frame to the next, in its diagonals a frame
_ERROR = 0.03  # of a detected centre, in diagonals


@dataclass
class _Object:
    """One object: its last box, and a filter of its centre at steady speed."""

    identity: int
    name: str
    edges: np.ndarray  # (4,)
    state: np.ndarray  # (2, 2): place and speed, by axis
    spread: np.ndarray  # (2, 2): covariance of place and speed, the same for both axes
    missed: int = 0

    def ahead(self) -> np.ndarray:
        """Moves the filter on by a frame; the box that it expects."""
        step = np.array([[1.0, 1.0], [0.0, 1.0]])
        self.state = step @ self.state
        jump = (_JUMP * self._diagonal) ** 2
        self.spread = step @ self.spread @ step.T + jump * np.array([[0.25, 0.5], [0.5, 1.0]])
        half = (self.edges[2:] - self.edges[:2]) / 2
        return np.concatenate([self.state[0] - half, self.state[0] + half])

    def seen(self, edges: np.ndarray) -> None:
        """Takes a box for its own."""
        error = (_ERROR * self._diagonal) ** 2
        gain = self.spread[:, 0] / (self.spread[0, 0] + error)
        off = (edges[:2] + edges[2:]) / 2 - self.state[0]
        self.state = self.state + gain[:, None] * off[None, :]
        self.spread = self.spread - gain[:, None] * self.spread[None, 0, :]
        self.edges, self.missed = edges, 0

    @property
    def _diagonal(self) -> float:
        return float(np.linalg.norm(self.edges[2:] - self.edges[:2]))


def tracked(boxes: Iterable[Box], fps: float) -> list[Box]:
    """The boxes with an identity each, in order of time.

    After SORT (Bewley et al., 2016): each object moves on steadily by its Kalman filter, and the
    boxes of the next frame go to the objects that they overlap most, all at once. Here boxes of
    another class never match, and a box that overlaps nothing may still match what is near.

    >>> row = (0.0, 0.0, 9.0, 9.0)
    >>> [one.track for one in tracked([Box(0, "cup", row), Box(1, "cup", row)], 10.0)]
    ['1', '1']
    """
    frames = _by_frame(boxes)
    objects: list[_Object] = []
    found: list[Box] = []
    count = 0
    for frame in range(max(frames, default=-1) + 1):
        now = frames.get(frame, [])
        owner = _matched(objects, now)
        for index, one in enumerate(now):
            edges = np.array(one.edges)
            if index in owner:
                owner[index].seen(edges)
            else:
                count += 1
                state = np.stack([(edges[:2] + edges[2:]) / 2, np.zeros(2)])
                size = float(np.sum((edges[2:] - edges[:2]) ** 2))
                spread = np.diag([_ERROR**2 * size, size])
                owner[index] = _Object(count, one.name, edges, state, spread)
                objects.append(owner[index])
            found.append(one._replace(track=str(owner[index].identity)))
        current = {id(one) for one in owner.values()}
        for each in objects:
            each.missed += id(each) not in current
        objects = [each for each in objects if each.missed <= _PATIENCE * fps]
    return found


def _matched(objects: Sequence[_Object], boxes: Sequence[Box]) -> dict[int, _Object]:
    """The object of each box that has one."""
    expected = np.array([each.ahead() for each in objects]).reshape(-1, 4)
    given = np.array([one.edges for one in boxes]).reshape(-1, 4)
    if not len(objects) or not len(boxes):
        return {}
    likeness = overlap(given[:, None], expected[None])
    other = np.array([[one.name != each.name for each in objects] for one in boxes])
    rows, columns = linear_sum_assignment(np.where(other, 4.0, -likeness))
    pairs = zip(rows.tolist(), columns.tolist(), strict=True)
    return {r: objects[c] for r, c in pairs if not other[r, c] and likeness[r, c] >= _LEAST}


def overlap(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Generalised overlap of boxes (..., 4): their common area over all of it, from 0 to 1, less
    the share of the box around both that is of neither (Rezatofighi et al., 2019)."""
    inner = np.minimum(one[..., 2:], other[..., 2:]) - np.maximum(one[..., :2], other[..., :2])
    outer = np.maximum(one[..., 2:], other[..., 2:]) - np.minimum(one[..., :2], other[..., :2])
    common = np.prod(np.maximum(inner, 0), axis=-1)
    areas = (np.prod(x[..., 2:] - x[..., :2], axis=-1) for x in (one, other))
    joint, whole = sum(areas) - common, np.prod(outer, axis=-1)
    return common / joint - (whole - joint) / whole
