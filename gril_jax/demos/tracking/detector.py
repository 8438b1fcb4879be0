"""Boxes by a detector of one's own, a function or `module:function`, called in this process.

    def detect(frames):                       # (T, H, W, 3) uint8, RGB
        return [[("cup", 317, 295, 371, 349, 0.93), ...], ...]   # of each frame

A box is a class, x_min, y_min, x_max, y_max in pixels, and if it likes a confidence.
"""

import importlib
import itertools
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from gril_jax.demos.formats.record import Box, Film, box, checked
from gril_jax.demos.vision.timed import frames_of
from gril_jax.errors import DemoError

Detect = Callable[[np.ndarray], Iterable[Sequence[tuple]]]
"""(frames) -> for each frame its boxes: class, x_min, y_min, x_max, y_max, and at most a
confidence, in pixels."""

_TOGETHER = 32  # frames that a detector is given at once


def detecting(given: str | Detect) -> Callable[[Film], list[Box]]:
    """(film) -> its boxes, by a function or that of this name."""
    detect = _found(given) if isinstance(given, str) else given
    name = given if isinstance(given, str) else getattr(given, "__name__", "detector")

    def boxes(film: Film) -> list[Box]:
        made, first = [], 0
        for frames in _batches(film):
            try:
                rows = list(detect(frames))
            except Exception as error:  # whatever a detector of theirs may raise
                raise DemoError(
                    f"{name}: failed on {film.path.name}, frames {first} to "
                    f"{first + len(frames) - 1} ({type(error).__name__}: {error})."
                ) from error
            if len(rows) != len(frames):
                raise DemoError(
                    f"{name}: gave boxes of {len(rows)} frames for {len(frames)} of "
                    f"{film.path.name}; it must give a list for each."
                )
            for frame, row in enumerate(rows, first):
                where = f"{name}, {film.path.name}, frame {frame}"
                made += [_box(film, frame, one, where) for one in row]
            first += len(frames)
        return checked(made, Path(name), film)

    return boxes


def _found(name: str) -> Detect:
    module, colon, function = name.partition(":")
    if not colon or not function:
        raise DemoError(f"the detector {name!r} must be module:function.")
    if "" not in sys.path:
        sys.path.insert(0, "")  # a file in the folder in which the command was given
    try:
        found = getattr(importlib.import_module(module), function)
    except (ImportError, AttributeError, ValueError, SyntaxError) as error:
        raise DemoError(f"the detector {name} cannot be imported ({error}).") from error
    if not callable(found):
        raise DemoError(f"the detector {name} is a {type(found).__name__}, but must be a function.")
    return found


def _batches(film: Film) -> Iterator[np.ndarray]:
    frames = frames_of(film)
    while batch := [*itertools.islice(frames, _TOGETHER)]:
        yield np.stack(batch)


def _box(film: Film, frame: int, given: object, where: str) -> Box:
    if not isinstance(given, (tuple, list)) or len(given) not in (5, 6):
        raise DemoError(
            f"{where}: a box must be class, x_min, y_min, x_max, y_max and at most a confidence, "
            f"not {given!r:.60}."
        )
    sure = given[5] if len(given) == 6 else 1.0
    return box(film, frame, given[0], given[1:5], where, confidence=sure)
