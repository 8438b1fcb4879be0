"""MOTChallenge text, which every tracker writes: a box a line, without column names.

    frame,id,left,top,width,height,confidence,class,visibility

Frames count from 1, and pixels from 0, as trackers write them (in MOTChallenge's own ground truth
all boxes lie one pixel to the lower right, as its tools know). A confidence of 0 marks what does
not count. A class is a name, or a number of the names file beside it, whose first line is class 1,
or 0 if a box is of class 0.
"""

import re
from pathlib import Path

from gril_jax.errors import DemoError

from .names import named, names_beside
from .record import Box, Film, box, checked, number, read_text, whole

_LEAST = 6  # columns, without confidence and class
_NUMBER = re.compile(r"-?\d+(\.0*)?")


def recognised(text: str) -> bool:
    """True for a first line of numbers."""
    cells = _cells(text.lstrip("\n").split("\n", 1)[0])
    return len(cells) >= _LEAST and all(re.fullmatch(r"-?[\d.]+(e-?\d+)?", x) for x in cells[:6])


def read(path: Path, film: Film) -> list[Box]:
    """The boxes of a file."""
    lines = [(n, _cells(x)) for n, x in enumerate(read_text(path).splitlines(), 1) if x.strip()]
    file, names = names_beside(path, film.path)
    numbers = [cells[7] for _, cells in lines if len(cells) > 7 and _NUMBER.fullmatch(cells[7])]
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
        name = _name(cells[7] if len(cells) > 7 else "-1", first, names, file, where)
        track = None if float(number(cells[1], "id", where)) < 0 else cells[1]
        found.append(box(film, frame, name, edges, where, confidence=sure, track=track))
    return checked(found, path, film)


def _cells(line: str) -> list[str]:
    parts = line.split(",") if "," in line else line.split()
    return [part.strip() for part in parts]


def _name(text: str, first: int, names: list[str], file: Path | None, where: str) -> str:
    if not _NUMBER.fullmatch(text):
        return text
    if float(text) < 0 and len(names) == 1:  # a tracker of one class leaves it out
        return names[0]
    return named(int(float(text)), first, names, file, where)
