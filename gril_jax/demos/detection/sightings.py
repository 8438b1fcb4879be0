"""What a detector found in a frame, before a threshold: boxes of named classes with their scores.

Few are kept of each class, so that a score or a number of objects can be chosen later without
finding them again.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

LEAST_SCORE = 0.02  # of a sighting that is kept
MOST = 8  # sightings kept of a class in a frame
_OVERLAP = 0.5  # shared part of two boxes of one class that are one object
_SMALLEST = 1.0  # pixels of a side


class Sighting(NamedTuple):
    """One box in one frame."""

    name: str  # of its class
    edges: tuple[float, float, float, float]  # x_min, y_min, x_max, y_max, pixels of the frame
    score: float


def best_of(
    edges: Float[np.ndarray, "N 4"],
    scores: Float[np.ndarray, "N C"],
    names: Sequence[str],
    width: int,
    height: int,
) -> list[Sighting]:
    """The best boxes of each class within a frame, without those that are an object's second ones.

    A candidate is of the class of its highest score. Boxes are cut at the edges of the frame, and
    what is not finite is no box.
    """
    edges = np.clip(edges, 0, [width, height] * 2)
    large = (edges[:, 2:] - edges[:, :2] >= _SMALLEST).all(axis=1)
    fine = large & np.isfinite(edges).all(axis=1) & np.isfinite(scores).all(axis=1)
    best = np.where(fine, scores.max(axis=1, initial=0.0), 0.0)
    found = []
    for number, name in enumerate(names):
        own = np.flatnonzero((best >= LEAST_SCORE) & (scores.argmax(axis=1) == number))
        if not len(own):
            continue
        sides = np.concatenate([edges[own, :2], edges[own, 2:] - edges[own, :2]], axis=1)
        # It takes doubles or floats, and keeps the order of the scores.
        kept = cv2.dnn.NMSBoxes(sides.tolist(), best[own].tolist(), LEAST_SCORE, _OVERLAP)
        found += [
            Sighting(name, tuple(edges[at].tolist()), float(best[at]))
            for at in own[np.asarray(kept, int).reshape(-1)[:MOST]]
        ]
    return found
