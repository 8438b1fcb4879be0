"""Our own CSV: a line of column names, then a box a line.

    frame,class,x_min,y_min,x_max,y_max,confidence,track
    0,cup,317,295,371,349,0.93,4

Columns come in any order; the last two may miss, and others are ignored. Several boxes of a class
in a frame are several objects; without the column `track` they are told apart by where they are.
The names that the sink of `supervision` gives its columns are known, too.
"""

import csv
from pathlib import Path

from gril_jax.errors import DemoError

from .record import Box, Film, box, checked, read_text, whole

COLUMNS = ("frame", "class", "x_min", "y_min", "x_max", "y_max")
_ALSO = {
    "frame_index": "frame", "frame_number": "frame", "class_name": "class", "tracker_id": "track",
    "track_id": "track",
}  # fmt: skip


def recognised(text: str) -> bool:
    """True for a first line that has the columns."""
    cells = [cell.strip().strip('"') for cell in text.split("\n", 1)[0].split(",")]
    return {"frame", "class"} <= {*_named(cells)}


def _named(header: list[str]) -> list[str]:
    """Column names as ours; another tool's name counts where ours is not there."""
    return [cell if _ALSO.get(cell, cell) in header else _ALSO.get(cell, cell) for cell in header]


def read(path: Path, film: Film) -> list[Box]:
    """The boxes of a file."""
    rows = csv.reader(read_text(path).splitlines())
    try:
        header = _named([cell.strip() for cell in next(rows, [])])
        if lacks := [column for column in COLUMNS if column not in header]:
            raise DemoError(
                f"{path}, line 1: the column {lacks[0]!r} is missing; there must be "
                f"{','.join(COLUMNS)}."
            )
        if twice := [column for column in header if header.count(column) > 1]:
            raise DemoError(f"{path}, line 1: the column {twice[0]!r:.60} is there twice.")
        return checked([_box(path, film, header, row, rows.line_num) for row in rows if row],
                       path, film)  # fmt: skip
    except csv.Error as error:
        raise DemoError(f"{path}, line {rows.line_num}: not CSV text ({error}).") from None


def _box(path: Path, film: Film, header: list[str], row: list[str], line: int) -> Box:
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
