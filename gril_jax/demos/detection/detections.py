"""Boxes of a frame as `Detections` of the package `supervision`, which many detectors and trackers
give. The package itself is not needed: what counts are its fields.
"""

from typing import Any

import numpy as np

from gril_jax.demos.formats.record import Box, Film, box
from gril_jax.errors import DemoError


def is_detections(value: object) -> bool:
    """True for an object with the fields of `supervision.Detections`."""
    return all(hasattr(value, name) for name in ("xyxy", "confidence", "class_id", "data"))


def boxes_of_detections(found: Any, film: Film, frame: int, where: str) -> list[Box]:
    """The boxes of one frame, with a tracker's identities if they have been given.

    The names of classes are those of `data["class_name"]`, as detectors write them there.
    """
    edges = np.asarray(found.xyxy, float).reshape(-1, 4)
    names = found.data.get("class_name") if isinstance(found.data, dict) else None
    if len(edges) and names is None:
        raise DemoError(
            f"{where}: these detections have no data['class_name'], but each box needs the name of "
            "its class."
        )
    sure = _column(found.confidence, len(edges), 1.0)
    tracks = _column(getattr(found, "tracker_id", None), len(edges), None)
    made = []
    for number, four in enumerate(edges.tolist()):
        one = f"{where}, box {number}"
        name = str(names[number])
        made.append(box(film, frame, name, four, one, confidence=sure[number],
                        track=tracks[number]))  # fmt: skip
    return made


def _column(values: Any, count: int, default: Any) -> list[Any]:
    return [default] * count if values is None else [*np.asarray(values).tolist()]
