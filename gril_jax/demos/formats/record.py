"""One box in one frame, as every format gives it, and the checks that all formats share.

Frames count from 0; edges are pixels of the video as it is shown, from its top left corner, y down.
Whatever does not fit is a `DemoError` that begins with the file and the line.
"""

import codecs
import json
import math
import os
import re
from collections.abc import Sequence
from pathlib import Path
from types import UnionType
from typing import Any, NamedTuple

from gril_jax.errors import DemoError, printable

from .names import class_name, composed

_LARGEST = 1e30  # pixels; beyond it, float32 would overflow
_AWAY = 100  # sides of the picture that an edge may lie outside of it
_LONGEST = 60  # letters of an identity
_BYTES = 1 << 28  # of a file of boxes; a long video's has some megabytes
_ALIKE = 0.95  # of what two boxes cover together: they are one box, written twice
_DIGITS = 9  # of a whole number, at most
# A number as `numpy.savetxt` writes it, too: 1, 1.00, 1.000e+00.
_WRITTEN = r"[+-]?\d+(\.\d*)?(e[+-]?\d+)?"


class Film(NamedTuple):
    """A video without its pictures, which boxes must fit."""

    path: Path
    times: Sequence[float]  # seconds, one a frame, from 0
    width: int  # pixels, as it is shown
    height: int
    begin: float | None = None  # seconds into the file, if it is a part of one
    title: str | None = None  # the name, if it is not that of the file
    note: str | None = None  # a sentence on its time stamps, if they had to be repaired
    first: float = 0.0  # seconds into the file at which its first frame is shown
    aspect: float = 1.0  # width of a pixel in its heights, as it is shown

    @property
    def name(self) -> str:
        """The name of the video, in printable letters."""
        return printable(composed(self.path.stem if self.title is None else self.title))

    @property
    def fps(self) -> float:
        """Frames per second, on average."""
        seconds = self.times[-1] - self.times[0]
        return (len(self.times) - 1) / seconds if seconds > 0 else 1.0


class Box(NamedTuple):
    """One object in one frame."""

    frame: int
    name: str  # of its class
    edges: tuple[float, float, float, float]  # x_min, y_min, x_max, y_max
    confidence: float = 1.0
    track: str | None = None  # identity, within the video; None where the tool gives none
    where: str = ""  # file and line
    drawn: bool = False  # by a person, who takes no object for another one


def read_text(path: Path) -> str:
    """A file's text; a DemoError if it is no regular file, not Unicode, or beyond 256 MiB."""
    if not path.is_file():  # a pipe or a device would never end
        raise DemoError(f"{path}: the boxes file cannot be read (no regular file).")
    try:
        if os.path.getsize(path) > _BYTES:
            raise DemoError(f"{path}: the boxes file is larger than 256 MiB.")
        with open(path, "rb") as file:  # what PowerShell and spreadsheets write begins so
            wide = file.read(2) in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
        return path.read_text(encoding="utf-16" if wide else "utf-8-sig")
    except OSError as error:
        raise DemoError(f"{path}: the boxes file cannot be read ({error.strerror}).") from error
    except UnicodeError as error:
        raise DemoError(f"{path}: the boxes file is not text in UTF-8.") from error


def number(value: Any, what: str, where: str) -> float:
    """A finite number from text or JSON."""
    try:
        found = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        found = math.nan
    if not abs(found) < _LARGEST:
        raise DemoError(f"{where}: {what} must be a number, not {value!r:.60}.")
    return found


def whole(value: Any, what: str, where: str, *, least: int) -> int:
    """A whole number that is not below the least."""
    text = str(value).strip()
    found = float(text) if is_number(text) else math.nan
    if not least <= found < 10**_DIGITS or found != int(found):
        raise DemoError(f"{where}: {what} must be a whole number from {least}, not {text!r:.60}.")
    return int(found)


def is_number(text: str) -> bool:
    """True for a number in digits.

    >>> [is_number(text) for text in ("1", "1.00", "1.000e+00", "-1", "one", "")]
    [True, True, True, True, False, False]
    """
    return len(text) < 40 and text.isascii() and bool(re.fullmatch(_WRITTEN, text, re.IGNORECASE))


def identity(value: Any) -> str | None:
    """An object's identity; None where a tool gives none, which is a number below 0 for some.

    >>> [identity(value) for value in (3, "3.00", "a7", -1, "-1.0", "", "nan", None)]
    ['3', '3', 'a7', None, None, None, None, None]
    """
    text = "" if value is None else printable(str(value).strip())
    if text.lower() in ("", "nan", "none", "null"):
        return None
    if not is_number(text):
        return text[:_LONGEST]
    number_ = float(text)
    if number_ < 0:
        return None
    written = "." in text and abs(number_) < 10**_DIGITS and number_ == int(number_)
    return str(int(number_)) if written else text


def box(
    film: Film,
    frame: int,
    name: Any,
    edges: Sequence[Any],
    where: str,
    *,
    confidence: Any = 1.0,
    track: Any = None,
    first: int = 0,
    drawn: bool = False,
) -> Box:
    """A checked box; `edges` are x_min, y_min, x_max, y_max, and `first` is the number that the
    file gives the first frame."""
    if frame >= len(film.times):
        raise DemoError(
            f"{where}: frame {frame + first} is beyond {film.name}, whose {len(film.times)} frames "
            f"count from {first} to {len(film.times) - 1 + first}."
        )
    places = ("x_min", "y_min", "x_max", "y_max")
    low_x, low_y, high_x, high_y = (
        number(edge, place, where) for edge, place in zip(edges, places, strict=True)
    )
    if low_x >= high_x or low_y >= high_y:
        raise DemoError(
            f"{where}: a box needs x_min < x_max and y_min < y_max, not {low_x:g}, {high_x:g} and "
            f"{low_y:g}, {high_y:g}."
        )
    for place, edge in zip(places, (low_x, low_y, high_x, high_y), strict=True):
        if abs(edge) > _AWAY * max(film.width, film.height):
            raise DemoError(
                f"{where}: {place} is {edge:g}, but {film.path.name} is {film.width} x "
                f"{film.height} pixels."
            )
    sure = number(confidence, "confidence", where)
    return Box(frame, class_name(name, where), (low_x, low_y, high_x, high_y), sure,
               identity(track), where, drawn)  # fmt: skip


def alike(one: Box, other: Box) -> bool:
    """True for two boxes of one class and identity that cover the same: one, written twice."""
    if (one.frame, one.name, one.track) != (other.frame, other.name, other.track):
        return False
    pairs = zip(one.edges, other.edges, strict=True)
    low_x, low_y, high_x, high_y = (
        pick(pair) for pick, pair in zip((max, max, min, min), pairs, strict=True)
    )
    both = max(high_x - low_x, 0.0) * max(high_y - low_y, 0.0)
    area = lambda edges: (edges[2] - edges[0]) * (edges[3] - edges[1])  # noqa: E731
    return both >= _ALIKE * (area(one.edges) + area(other.edges) - both)


def checked(boxes: list[Box], path: Path, film: Film) -> list[Box]:
    """The boxes in order of time; a DemoError if there is none, or a track is in a frame twice,
    at two places."""
    if not boxes:
        raise DemoError(f"{path}: the boxes file of {film.name} holds no box.")
    seen: dict[tuple[int, str, str], Box] = {}
    for one in boxes:
        key = (one.frame, one.name, one.track or "")
        if one.track is not None and key in seen and not alike(one, seen[key]):
            raise DemoError(
                f"{one.where}: a second box of {one.name!r} {one.track} in frame {one.frame}; an "
                "identity may be once in a frame."
            )
        seen[key] = one
    return sorted(boxes, key=lambda one: one.frame)


_MISSING = object()


def load(path: Path) -> Any:
    """A file's content; a DemoError with the line of a fault."""
    try:
        return json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise DemoError(f"{path}, line {error.lineno}: not JSON ({error.msg}).") from None
    except (ValueError, RecursionError):
        raise DemoError(
            f"{path}: not JSON that can be read; it is nested too deeply, or a number has "
            "thousands of digits."
        ) from None


def field(
    holder: Any, name: str, kind: type | UnionType, where: str, default: Any = _MISSING
) -> Any:
    """A field of an object, of a type; the default where it is missing, if there is one."""
    if not isinstance(holder, dict):
        raise DemoError(f"{where}: must be an object with fields, not {holder!r:.60}.")
    value = holder.get(name, default)
    if value is _MISSING:
        raise DemoError(f"{where}: the field {name!r} is missing.")
    if value is not default and not isinstance(value, kind):
        raise DemoError(
            f"{where}: {name} must be {getattr(kind, '__name__', 'a number')}, not {value!r:.60}."
        )
    return value
