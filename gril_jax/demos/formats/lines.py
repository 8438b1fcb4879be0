"""Boxes as lines of text: our own CSV, and MOTChallenge, which numbers classes.

A names file beside the boxes or the video has the name of a class in each line.
"""

import csv
from pathlib import Path

from gril_jax.errors import DemoError

from .clock import require_all_seen
from .names import class_name, there
from .record import Box, Film, box, checked, is_number, number, read_text, whole

COLUMNS = ("frame", "class", "x_min", "y_min", "x_max", "y_max")
_ALSO = {
    "frame_index": "frame", "frame_number": "frame", "class_name": "class", "tracker_id": "track",
    "track_id": "track",
}  # fmt: skip
_LEAST = 6  # columns, without confidence and class
FILES = ("names.txt", "classes.txt", "labels.txt", "obj.names")


def is_csv(text: str) -> bool:
    """True for a first line that has the columns."""
    cells = [cell.strip().strip('"') for cell in text.split("\n", 1)[0].split(",")]
    return {"frame", "class"} <= {*_columns(cells)}


def _columns(header: list[str]) -> list[str]:
    """Column names as ours; another tool's name counts where ours is not there."""
    return [cell if _ALSO.get(cell, cell) in header else _ALSO.get(cell, cell) for cell in header]


def read_csv(path: Path, film: Film) -> list[Box]:
    """The boxes of our own CSV: a line of column names, then a box a line.

        frame,class,x_min,y_min,x_max,y_max,confidence,track
        0,cup,317,295,371,349,0.93,4

    Columns come in any order; the last two may miss, and others are ignored. Several boxes of a
    class in a frame are several objects; without the column `track` they are told apart by where
    they are. The names that the sink of `supervision` gives its columns are known, too.
    """
    return checked(require_all_seen(path, film, csv_boxes(path, film)), path, film)


def csv_boxes(path: Path, film: Film) -> list[Box]:
    """The boxes of our own CSV as they stand there, which may be none."""
    rows = csv.reader(read_text(path).splitlines())
    try:
        header = _columns([cell.strip() for cell in next(rows, [])])
        if lacks := [column for column in COLUMNS if column not in header]:
            raise DemoError(
                f"{path}, line 1: the column {lacks[0]!r} is missing; there must be "
                f"{','.join(COLUMNS)}."
            )
        if twice := [column for column in header if header.count(column) > 1]:
            raise DemoError(f"{path}, line 1: the column {twice[0]!r:.60} is there twice.")
        return [
            _csv_box(path, film, header, row, rows.line_num)
            for row in rows
            if row and _columns([cell.strip() for cell in row]) != header  # appended to itself
        ]
    except csv.Error as error:
        raise DemoError(f"{path}, line {rows.line_num}: not CSV text ({error}).") from None


def _csv_box(path: Path, film: Film, header: list[str], row: list[str], line: int) -> Box:
    where = f"{path}, line {line}"
    if len(row) != len(header):
        raise DemoError(
            f"{where}: {len(row)} cells where {len(header)} are needed ({','.join(header)[:200]})."
        )
    cells = dict(zip(header, (cell.strip() for cell in row), strict=True))
    frame = whole(cells["frame"], "frame", where, least=0)
    edges = [cells[column] for column in COLUMNS[2:]]
    sure = cells.get("confidence") or 1.0
    return box(film, frame, cells["class"], edges, where, confidence=sure, track=cells.get("track"))


def is_mot(text: str) -> bool:
    """True for a first line of numbers."""
    cells = _cells(text.lstrip("\n").split("\n", 1)[0])
    return len(cells) >= _LEAST and all(map(is_number, cells[:_LEAST]))


def read_mot(path: Path, film: Film) -> list[Box]:
    """The boxes of MOTChallenge text, which every tracker writes, without column names.

        frame,id,left,top,width,height,confidence,class,visibility

    Frames count from 1, and pixels from 0, as trackers write them. (In MOTChallenge's own ground
    truth all boxes lie one pixel to the lower right, as its tools know.) A box with a confidence
    of 0 does not count, and an id below 0 is none. A class is a name, or a number of the names
    file. Its first line is class 1, or class 0 if a box is of class 0.
    """
    lines = [(n, _cells(x)) for n, x in enumerate(read_text(path).splitlines(), 1) if x.strip()]
    file, names = names_beside(path, film.path)
    numbers = [cells[7] for _, cells in lines if len(cells) > 7 and is_number(cells[7])]
    first = 0 if any(float(text) == 0 for text in numbers) else 1
    found = []
    for line, cells in lines:
        where = f"{path}, line {line}"
        if len(cells) < _LEAST:
            raise DemoError(
                f"{where}: {len(cells)} columns, but there must be frame, id, left, top, width, "
                "height, confidence, class."
            )
        frame = whole(cells[0], "frame", where, least=1) - 1
        sure = number(cells[6], "confidence", where) if len(cells) > 6 else 1.0
        if sure == 0:
            continue
        left, top, width, height = (number(x, "a box", where) for x in cells[2:6])
        edges = (left, top, left + width, top + height)
        name = _class_of(cells[7] if len(cells) > 7 else "-1", first, names, file, where)
        number(cells[1], "id", where)
        found.append(box(film, frame, name, edges, where, confidence=sure, track=cells[1]))
    return checked(require_all_seen(path, film, found), path, film)


def _cells(line: str) -> list[str]:
    parts = line.split(",") if "," in line else line.split()
    return [part.strip() for part in parts]


def _class_of(text: str, first: int, names: list[str], file: Path | None, where: str) -> str:
    if not is_number(text):
        return text
    if float(text) < 0 and len(names) == 1:  # a tracker of one class leaves it out
        return names[0]
    number_ = -1 if float(text) < 0 else whole(text, "class", where, least=0)
    return named(number_, first, names, file, where)


def names_beside(path: Path, film: Path) -> tuple[Path | None, list[str]]:
    """The names file of a video, and its names: NAME.names, or one of `FILES` beside the boxes or
    the video; nothing where there is none."""
    folders = dict.fromkeys((path if path.is_dir() else path.parent, film.parent))
    places = [film.with_suffix(".names"), *(folder / name for folder in folders for name in FILES)]
    for place in places:
        if (place := there(place)).is_file() and place != path:
            return place, names_in(place)
    return None, []


def names_in(file: Path) -> list[str]:
    """The names of a file, one a line; a DemoError if one comes twice."""
    found: dict[str, int] = {}
    for at, line in enumerate(read_text(file).splitlines(), 1):
        if not line.strip():
            continue
        name = class_name(line, f"{file}, line {at}")
        if name in found:
            raise DemoError(
                f"{file}, line {at}: {name!r} stands in line {found[name]}, too, but each "
                "class needs a name of its own."
            )
        found[name] = at
    return [*found]


def named(number: int, first: int, names: list[str], file: Path | None, where: str) -> str:
    """The name of a numbered class, of which the first has the number `first`."""
    if file is None:
        raise DemoError(
            f"{where}: class {number} is a number, but no names are beside the video: write "
            f"{FILES[0]} there, a name a line."
        )
    if not 0 <= number - first < len(names):
        raise DemoError(
            f"{where}: class {number} is not among the {len(names)} names of {file.name}, which "
            f"are numbered from {first}."
        )
    return names[number - first]
