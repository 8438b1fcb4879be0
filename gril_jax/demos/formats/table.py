"""Boxes as a table with column names: CSV of one's own, of a spreadsheet, or of another tool.

Columns are told by their names, in any order, and other tools' names are known. A spreadsheet of
some countries writes semicolons and decimal commas. Comments, empty lines and lines of empty cells
say nothing; a box whose four edges are empty or NaN is of an object that is not seen.
"""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from gril_jax.errors import DemoError

from .clock import first_of, require_all_seen
from .lines import is_said, named, names_beside, unseen
from .record import Box, Film, box, checked, is_number, read_text, whole

COLUMNS = ("frame", "class", "x_min", "y_min", "x_max", "y_max")
_NAMES = {  # of each column, the one that counts first
    "frame": ("frame", "frame_index", "frame_number", "frame_id", "frame_idx"),
    "class": ("class_name", "class", "label", "category", "class_id"),
    "x_min": ("x_min", "xmin", "x1"),
    "y_min": ("y_min", "ymin", "y1"),
    "x_max": ("x_max", "xmax", "x2"),
    "y_max": ("y_max", "ymax", "y2"),
    "confidence": ("confidence", "conf", "score"),
    "track": ("track", "tracker_id", "track_id"),
}
_SEPARATORS = ",;\t"
_BEFORE = 20  # lines that may stand before the column names


class _Head(NamedTuple):
    """The line of the column names."""

    line: int  # from 1
    separator: str
    names: list[str]  # as they are written, but in small letters
    places: dict[str, int]  # of our columns


def is_csv(text: str) -> bool:
    """True for text that begins with column names, of which one is the frame and one the class."""
    return _head(text.splitlines()) is not None


def read_csv(path: Path, film: Film) -> list[Box]:
    """The boxes of a line of column names, then a box a line.

        frame,class,x_min,y_min,x_max,y_max,confidence,track
        0,cup,317,295,371,349,0.93,4

    Columns come in any order; the last two may miss, and others are ignored. Frames count from 0,
    or from 1 if none is 0 and one is the number of frames. Several boxes of a class in a frame are
    several objects; without a track they are told apart by where they are. Where all classes are
    numbers and a names file is beside the video, they are its names, from 0.
    """
    lines = read_text(path).splitlines()
    head = _head(lines)
    _require_columns(head, path)
    rows = csv.reader(lines[head.line :], delimiter=head.separator)
    found: list[tuple[str, dict[str, str]]] = []
    try:
        for row in rows:
            where = f"{path}, line {head.line + rows.line_num}"
            if is_said(row) and _small(row) != head.names:  # appended to itself
                found.append((where, _cells(row, head, where)))
    except csv.Error as error:
        at = head.line + rows.line_num
        raise DemoError(f"{path}, line {at}: not CSV text ({error}).") from None
    found = [(where, cells) for where, cells in found if not unseen(_edges(cells))]
    numbers = [whole(cells["frame"], "frame", where, least=0) for where, cells in found]
    several = len({*numbers}) > 1  # one number tells no clock
    first = first_of(numbers, film, "frame", str(path), usual=0) if several else 0
    classes = _classes([cells["class"] for _, cells in found], path, film)
    boxes = [
        box(film, number - first, name, _edges(cells), where, first=first,
            confidence=_sure(cells), track=cells.get("track"))
        for number, name, (where, cells) in zip(numbers, classes, found, strict=True)
    ]  # fmt: skip
    return checked(require_all_seen(path, film, boxes), path, film)


def _head(lines: Sequence[str]) -> _Head | None:
    for number, line in enumerate(lines[:_BEFORE], 1):
        for separator in _SEPARATORS:
            try:
                names = _small(next(csv.reader([line], delimiter=separator), []))
            except csv.Error:
                continue
            places = {
                ours: names.index(known[0])
                for ours, theirs in _NAMES.items()
                if (known := [name for name in theirs if name in names])
            }
            if {"frame", "class"} <= {*places}:
                return _Head(number, separator, names, places)
        if is_said([line]) and not line.lower().startswith("sep="):  # Excel's own first line
            return None
    return None


def _small(row: Sequence[str]) -> list[str]:
    return [cell.strip().lower() for cell in row]


def _require_columns(head: _Head, path: Path) -> None:
    where = f"{path}, line {head.line}"
    if lacks := [column for column in COLUMNS if column not in head.places]:
        raise DemoError(
            f"{where}: the column {lacks[0]!r} is missing; there must be {','.join(COLUMNS)}."
        )
    for ours, at in head.places.items():
        # Two names for one identity, say, may contradict each other; a class has number and name.
        twice = [name for name in head.names if name in _NAMES[ours]]
        if len(twice) > 1 and (ours != "class" or head.names.count(head.names[at]) > 1):
            raise DemoError(f"{where}: the column {ours!r} is there twice.")


def _cells(row: list[str], head: _Head, where: str) -> dict[str, str]:
    """The cells of our columns in a row, which may have empty cells too many at its end."""
    while len(row) > len(head.names) and not row[-1].strip():
        row.pop()
    if len(row) != len(head.names):
        raise DemoError(
            f"{where}: {len(row)} cells where {len(head.names)} are needed "
            f"({','.join(head.names)[:200]})."
        )
    cells = {ours: row[at].strip() for ours, at in head.places.items()}
    return {ours: text if ours == "class" else _decimal(text) for ours, text in cells.items()}


def _decimal(text: str) -> str:
    """A number with a decimal comma as one with a point; other text as it is."""
    pointed = text.replace(",", ".")
    return pointed if is_number(pointed) else text


def _edges(cells: dict[str, str]) -> list[str]:
    return [cells[column] for column in COLUMNS[2:]]


def _sure(cells: dict[str, str]) -> str | float:
    text = cells.get("confidence", "")
    return 1.0 if unseen([text]) else text


def _classes(texts: list[str], path: Path, film: Film) -> list[str]:
    """The names of classes, which may be numbers of a names file."""
    file, names = names_beside(path, film.path)
    if file is None or not all(map(is_number, texts)):
        return texts
    where = str(path)
    return [named(whole(text, "class", where, least=0), 0, names, file, where) for text in texts]
