"""Boxes by a detector of the user's own: a function, or its name, called in this process.

A name is FILE.py:FUNCTION, as that of a task, or module:function.

    def detect(frames):                       # (T, H, W, 3) uint8, RGB
        return [[("cup", 317, 295, 371, 349, 0.93), ...], ...]   # of each frame

A box is a class, x_min, y_min, x_max, y_max in pixels, and if it likes a confidence. None in place
of a frame's boxes is no box, as detectors of hands answer where there is none. A frame's boxes may
also be `Detections` of the package `supervision`, whose tracker's identities then count.
"""

import importlib.util
import itertools
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from gril_jax.errors import DemoError

from .detection.detections import boxes_of_detections, is_detections
from .formats.record import Box, Film, box, checked
from .vision.timed import frames_of

Detect = Callable[[np.ndarray], Iterable[Any]]
"""(frames) -> for each frame its boxes: class, x_min, y_min, x_max, y_max, and at most a
confidence, in pixels; or `supervision.Detections`. None is no box."""

_TOGETHER = 32  # frames that a detector is given at once
# Whatever code of theirs may raise; a detector must not end the import as if it were done.
_FAILURES = (Exception, SystemExit)
_LONGEST = 200  # letters of what it says


class _Detector(NamedTuple):
    """A function, its name, and the file and line where it stands."""

    call: Detect
    name: str
    where: str


def detecting(given: str | Detect) -> Callable[[Film], list[Box]]:
    """(video) -> its boxes, by a function or that of this name."""
    call = _found(given) if isinstance(given, str) else given
    name = given if isinstance(given, str) else getattr(given, "__name__", "detector")
    code = getattr(call, "__code__", None)
    where = "" if code is None else f" ({code.co_filename}, line {code.co_firstlineno})"
    detector = _Detector(call, name, where)

    def boxes(film: Film) -> list[Box]:
        made, first = [], 0
        for frames in _batches(film):
            for frame, row in enumerate(_rows(detector, film, frames, first), first):
                made += _boxes(detector, film, frame, row)
            first += len(frames)
        if not made:
            raise DemoError(
                f"{name}{where}: found no box in any of the {first} frames of {film.path.name}."
            )
        return checked(made, Path(name), film)

    return boxes


def _rows(detector: _Detector, film: Film, frames: np.ndarray, first: int) -> list:
    """What a detector gives for each of some frames; a DemoError where it fails or gives others."""
    rows, last = [], first + len(frames) - 1
    begun = False
    try:
        answer = detector.call(frames)
        if answer is None or isinstance(answer, str | dict) or is_detections(answer):
            given = " ".join(repr(answer).split())
            raise DemoError(
                f"{detector.name}{detector.where}: gave {given:.60} for frames {first} to "
                f"{last} of {film.path.name}; it must give a list with the boxes of each frame."
            )
        begun = not isinstance(answer, list | tuple | np.ndarray)
        # A generator works, and fails, a frame at a time; one without an end is stopped.
        for row in itertools.islice(answer, len(frames) + 1):
            rows.append(row)
    except DemoError:
        raise
    except _FAILURES as error:
        at = f"frame {first + len(rows)}" if begun else f"frames {first} to {last}"
        raise DemoError(
            f"{detector.name}: failed on {film.path.name}, {at} ({_said(error)}{_line(error)})."
        ) from error
    if len(rows) != len(frames):
        given = f"{len(rows)}" if len(rows) < len(frames) else f"more than {len(frames)}"
        raise DemoError(
            f"{detector.name}{detector.where}: gave boxes of {given} frames for {len(frames)} "
            f"of {film.path.name}; it must give a list for each."
        )
    return rows


def _boxes(detector: _Detector, film: Film, frame: int, row: object) -> list[Box]:
    part = film.path.name if film.title is None else film.title  # a file may hold many videos
    where = f"{detector.name}{detector.where}, {part}, frame {frame}"
    if row is None:
        return []
    if is_detections(row):
        return boxes_of_detections(row, film, frame, where)
    try:
        given = [*row]
    except TypeError:
        raise DemoError(
            f"{where}: boxes must be a list of them or None, not {row!r:.60}."
        ) from None
    except _FAILURES as error:
        raise DemoError(f"{where}: failed ({_said(error)}{_line(error)}).") from error
    return [_box(film, frame, one, where) for one in given]


def _box(film: Film, frame: int, given: object, where: str) -> Box:
    if not isinstance(given, (tuple, list)) or len(given) not in (5, 6):
        raise DemoError(
            f"{where}: a box must be class, x_min, y_min, x_max, y_max and at most a confidence, "
            f"not {' '.join(repr(given).split()):.60}."
        )
    sure = given[5] if len(given) == 6 else 1.0
    return box(film, frame, given[0], given[1:5], where, confidence=sure)


def _found(name: str) -> Detect:
    module, colon, function = name.rpartition(":")
    file = Path(module).expanduser() if module.endswith(".py") else None
    if not colon or not function.isidentifier():
        raise DemoError(f"the detector {name!r} must be FILE.py:FUNCTION, or module:function.")
    if file is not None and not file.is_file():
        raise DemoError(f"the detector file {file} does not exist.")
    try:
        if file is not None:
            found = getattr(_run(file.absolute()), function)
        else:
            if "" not in sys.path:
                sys.path.insert(0, "")  # a file in the folder in which the command was given
            found = getattr(importlib.import_module(module), function)
    except _FAILURES as error:
        said = f"{error}" if isinstance(error, ImportError | AttributeError) else _said(error)
        raise DemoError(
            f"the detector {name} cannot be imported ({said[:_LONGEST]}{_line(error)})."
        ) from error
    if not callable(found):
        raise DemoError(f"the detector {name} is a {type(found).__name__}, but must be a function.")
    return found


def _run(file: Path) -> ModuleType:
    """The module of a file; it may import others from the folder it lies in."""
    if str(file.parent) not in sys.path:
        sys.path.append(str(file.parent))
    spec = importlib.util.spec_from_file_location(f"gril_detector_{file.stem}", file)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def _said(error: BaseException) -> str:
    """A failure in a line."""
    if isinstance(error, SyntaxError):
        return f"{error}"[:_LONGEST]
    if isinstance(error, SystemExit):
        return f"it called sys.exit({error.code!r:.60})"
    words = " ".join(f"{error}".split())[:_LONGEST]
    return f"{type(error).__name__}: {words}" if words else type(error).__name__


def _line(error: BaseException) -> str:
    """Where the user's code failed, if it did: the last of its own lines, not a library's."""
    steps = traceback.extract_tb(error.__traceback__)[1:]
    own = [
        one for one in steps if "<frozen" not in one.filename and "importlib" not in one.filename
    ]
    near = [one for one in own if "site-packages" not in one.filename] or own
    return f", in {near[-1].filename}, line {near[-1].lineno}" if near else ""


def _batches(film: Film) -> Iterator[np.ndarray]:
    frames = frames_of(film)
    while batch := [*itertools.islice(frames, _TOGETHER)]:
        yield np.stack(batch)
