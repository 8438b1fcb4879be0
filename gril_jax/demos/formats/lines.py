"""Boxes as lines of numbers, MOTChallenge's text, and the names of numbered classes.

A names file beside the boxes or the video has the name of a class in each line.
"""

import configparser
import functools
import re
from collections.abc import Sequence
from pathlib import Path

from gril_jax.errors import DemoError

from .clock import require_all_seen
from .names import class_name, there
from .record import Box, Film, box, checked, is_number, number, read_text, whole

_LEAST = 6  # columns, without confidence and class
_NONE = ("", "nan", "none", "null", "na", "n/a")  # what tools write where there is no number
FILES = ("names.txt", "classes.txt", "labels.txt", "obj.names")
_NUMBERED = re.compile(r"(\d+)\s*[:=,;)\s]\s*\S")  # a name with its number before it


def is_said(cells: Sequence[str]) -> bool:
    """True for the cells of a line that is neither empty nor a comment."""
    return any(cell.strip() for cell in cells) and not cells[0].lstrip().startswith("#")


def unseen(cells: Sequence[str]) -> bool:
    """True if no cell has a number, as tools write what they do not see."""
    return all(cell.strip().lower() in _NONE for cell in cells)


def is_mot(text: str) -> bool:
    """True if the first line that says something is of numbers."""
    said = (line for line in text.splitlines() if is_said([line]))
    cells = _cells(next(said, ""))
    numbers = [cell for cell in cells[:_LEAST] if is_number(cell) or unseen([cell])]
    return len(numbers) == _LEAST and is_number(cells[0])


def read_mot(path: Path, film: Film) -> list[Box]:
    """The boxes of MOTChallenge text, which every tracker writes, without column names.

        frame,id,left,top,width,height,confidence,class,visibility

    Frames count from 1, or from 0 if one is 0, and pixels from 0, as trackers write them. (In
    MOTChallenge's own ground truth all boxes lie one pixel to the lower right, as its tools know.)
    A box with a confidence of 0 does not count, and an id below 0 is none. A class is a name, or a
    number of the names file. Its first line is class 1, or class 0 if a box is of class 0. A frame
    or class 0 counts in any text of the folder: a video may not show the first class.
    """
    texts = enumerate(read_text(path).splitlines(), 1)
    lines = [(f"{path}, line {n}", _cells(text)) for n, text in texts if is_said([text])]
    _require_sequence(path, film)
    for where, cells in lines:
        if len(cells) < _LEAST:
            raise DemoError(
                f"{where}: {len(cells)} columns, but there must be frame, id, left, top, width, "
                "height, confidence, class."
            )
    frames = [whole(cells[0], "frame", where, least=0) for where, cells in lines]
    file, names = names_beside(path, film.path)
    each = [_zeros(one, one.stat().st_mtime_ns) for one in _texts(path)]
    begin, first = (0 if any(zeros) else 1 for zeros in zip(*each, strict=True))
    found = []
    for frame, (where, cells) in zip(frames, lines, strict=True):
        told = len(cells) > 6 and not unseen(cells[6:7])
        sure = number(cells[6], "confidence", where) if told else 1.0
        if sure == 0 or unseen(cells[2:6]):
            continue
        left, top, width, height = (number(x, "a box", where) for x in cells[2:6])
        edges = (left, top, left + width, top + height)
        name = _class_of(cells[7] if len(cells) > 7 else "-1", first, names, file, where)
        number(cells[1], "id", where)
        found.append(
            box(film, frame - begin, name, edges, where, first=begin, confidence=sure,
                track=cells[1])
        )  # fmt: skip
    return checked(require_all_seen(path, film, found), path, film)


def _texts(path: Path) -> list[Path]:
    """The text and all others of its kind beside it, but those of names."""
    beside = [one for one in path.parent.glob(f"*{path.suffix}") if one.is_file()]
    return [path, *(one for one in beside if one.name not in FILES)]


@functools.lru_cache(maxsize=1024)
def _zeros(path: Path, _: int) -> tuple[bool, bool]:
    """A pair: True if a text of boxes has a frame 0, and a class 0; of another text neither."""
    try:
        text = read_text(path)
    except DemoError:
        return False, False
    if not is_mot(text):
        return False, False
    lines = [cells for line in text.splitlines() if is_said(cells := _cells(line))]
    columns = ([x[at] for x in lines if len(x) > at and is_number(x[at])] for at in (0, 7))
    frame, kind = (any(float(x) == 0 for x in column) for column in columns)
    return frame, kind


def _require_sequence(path: Path, film: Film) -> None:
    """Raises DemoError if the seqinfo.ini of a MOTChallenge folder is of another video."""
    about = path.parent.parent / "seqinfo.ini"
    if path.parent.name != "gt" or not about.is_file():
        return
    parser = configparser.ConfigParser(interpolation=None)
    try:
        parser.read_string(read_text(about))
    except configparser.Error as error:
        said = str(error).splitlines()[0]
        raise DemoError(f"{about}: not the text of a MOTChallenge sequence ({said}).") from None
    said = {key: text for name in parser.sections() for key, text in parser[name].items()}
    true = {"seqlength": len(film.times), "imwidth": film.width, "imheight": film.height}
    for key, count in true.items():
        if key in said and whole(said[key], key, str(about), least=0) != count:
            raise DemoError(
                f"{about}: {key} is {said[key]}, but {film.path.name} has {len(film.times)} frames "
                f"of {film.width} x {film.height} pixels; the boxes must be of this very video."
            )


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
    """The names of a file, one a line; a DemoError if one comes twice or a line is empty."""
    lines = read_text(file).rstrip().splitlines()
    found: dict[str, int] = {}
    for at, line in enumerate(lines, 1):
        where = f"{file}, line {at}"
        if not line.strip():
            continue
        name = class_name(line, where)
        if name in found:
            raise DemoError(
                f"{where}: {name!r} stands in line {found[name]}, too, but each class needs a name "
                "of its own."
            )
        found[name] = at
    if empty := [at for at, line in enumerate(lines, 1) if not line.strip()]:
        raise DemoError(
            f"{file}, line {empty[0]}: the line is empty, so the numbers of the classes after it "
            "are not known."
        )
    numbered = [_NUMBERED.match(name) for name in found]
    if numbered and all(numbered) and int(numbered[0][1]) < 2:
        raise DemoError(
            f"{file}, line 1: {next(iter(found))!r} is a number and a name, but a line must be the "
            "name alone; the first is class 0 of YOLO, and class 1 of MOTChallenge."
        )
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
