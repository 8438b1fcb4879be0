"""Boxes of a video as objects: which box of a frame is which object of a class.

Objects of one class are told apart by their positions from frame to frame, and by a tracker's
identity while that lasts. A detector's boxes have no identity. Shapes use T for frames and K for
the objects of one class.
"""

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment

from gril_jax.demos.formats.record import Box

_OFTEN = 0.2  # share of the frames that show a class: as many objects as they show are there
_FAR = 2.0  # diagonals of the box: a box further from every known object is another one
_MOVES = 0.5  # diagonals
_SAME = 1.0  # diagonals that an equal identity outweighs
_ANY = 1e9  # the same where there is no telling by places


class Linked(NamedTuple):
    """The objects of one class in a video."""

    edges: Float[np.ndarray, "T K 4"]  # x_min, y_min, x_max, y_max; NaN where it is not seen
    renewed: int  # times that a tracker went on with another identity
    extra: int  # boxes that are of no object: second sightings of one


def objects_at_once(boxes: Sequence[Box]) -> dict[str, int]:
    """The number of objects of each class that a video shows at once, in a fifth of the frames that
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


def linked(boxes: Sequence[Box], frames: int, count: int, *, sparse: bool = False) -> Linked:
    """The boxes of one class as `count` objects, in order of their first sighting.

    A box goes to the object that was last seen near it and in its shape: a spoon that is brought
    over a cup stays a spoon, whatever both are called.

    `sparse` boxes are so far apart in time that an object may be anywhere in the next one. Then an
    equal identity outweighs any distance, and what is far away is no other object.
    """
    far, alike = (np.inf, _ANY) if sparse else (_FAR, _SAME)
    edges = np.full((frames, count, 4), np.nan)
    place, known = np.zeros((count, 2)), 0  # of the objects found so far
    sides = np.ones((count, 2))
    identity: list[str | None] = [None] * count
    renewed = extra = 0
    frames_of: dict[int, list[Box]] = {}
    for one in boxes:
        frames_of.setdefault(one.frame, []).append(one)
    for frame, now in sorted(frames_of.items()):
        corners = np.array([one.edges for one in now])
        center = (corners[:, :2] + corners[:, 2:]) / 2
        size = corners[:, 2:] - corners[:, :2]
        diagonal = np.linalg.norm(size, axis=1)
        same = np.array([[one.track is not None and one.track == identity[k] for k in range(known)]
                         for one in now], bool).reshape(len(now), known)  # fmt: skip
        apart = np.linalg.norm(center[:, None] - place[None, :known], axis=-1) / diagonal[:, None]
        grown = np.abs(np.log(size[:, None] / sides[None, :known])).sum(axis=-1)
        cost = apart + grown - alike * same
        rows, columns = linear_sum_assignment(cost) if known else (np.array([], int),) * 2
        free = {*range(len(now))}
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
            if known < count and not same[row, column] and apart[row, column] > far:
                continue  # an object that has not been seen before
            free.discard(row)
            renewed += now[row].track is not None and identity[column] not in (None, now[row].track)
            edges[frame, column] = corners[row]
            place[column], sides[column] = center[row], size[row]
            identity[column] = now[row].track or identity[column]
        for row in sorted(free, key=lambda row: -now[row].confidence):
            if known == count:
                extra += 1
                continue
            edges[frame, known] = corners[row]
            place[known], sides[known] = center[row], size[row]
            identity[known] = now[row].track
            known += 1
    return Linked(edges, renewed, extra)


def in_order(edges: Float[np.ndarray, "T K 4"]) -> Int[np.ndarray, "K"]:
    """The objects of one class, in the same order in every video.

    First come those that move, by when they first move. Those that rest follow from left to right,
    and at the end those that are never seen. `edges` are repaired. An object moves once it is half
    of its box's diagonal from where it began.
    """
    center = (edges[..., :2] + edges[..., 2:]) / 2
    diagonal = np.linalg.norm(edges[0, :, 2:] - edges[0, :, :2], axis=-1)
    moved = np.linalg.norm(center - center[0], axis=-1) > _MOVES * diagonal
    first = np.where(moved.any(axis=0), moved.argmax(axis=0), len(edges))
    never = np.isnan(center[0, :, 0])
    return np.lexsort((np.nan_to_num(center[0, :, 0]), first, never))
