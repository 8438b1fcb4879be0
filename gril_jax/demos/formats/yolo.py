"""YOLO: a folder with a text a frame, of whose lines each is a numbered class and its box."""

import re
from pathlib import Path

from gril_jax.demos.folders import visible
from gril_jax.errors import DemoError

from .clock import bare, require_whole
from .lines import FILES, named, names_beside
from .record import Box, Film, box, checked, is_number, number, read_text, whole

_TRACK = re.compile(r"-?\d+(\.0*)?")  # whole, or -1 for none


def is_folder(path: Path) -> bool:
    """True for a folder with texts, as of each frame."""
    return (path / "labels").is_dir() or any(map(_is_text, visible(path, "*")))


def _is_text(path: Path) -> bool:
    return path.suffix.lower() == ".txt" and path.name.lower() not in FILES


def is_yolo(text: str) -> bool:
    """True for a first line of YOLO text: a class and four shares of the picture."""
    cells = text.lstrip("\n").split("\n", 1)[0].split()
    if len(cells) not in (5, 6, 7) or not all(map(is_number, cells)):
        return False
    return cells[0].isdigit() and all("." in x and 0 <= float(x) <= 1 for x in cells[1:5])


def read(path: Path, film: Film) -> list[Box]:
    """The boxes of a folder with a file of YOLO text a frame, whose name ends with its number.

        class centre_x centre_y width height [confidence] [track]

    Lengths are shares of the picture; classes are numbers from 0 of the names file. Frames count
    from 1, or from 0 if there is a file of that number. One further column is a track if all its
    values are whole numbers, else a confidence. A frame without a file shows nothing.
    """
    folder = path / "labels" if (path / "labels").is_dir() else path
    files = {}
    for file in filter(_is_text, visible(folder, "*")):
        ending = re.search(r"(\d+)$", bare(file.name))
        if ending is None:
            raise DemoError(f"{file}: the name must end with the frame's number.")
        if (frame := int(ending[1])) in files:
            raise DemoError(f"{file}: {files[frame].name} is of frame {frame}, too.")
        files[frame] = file
    if not files:
        raise DemoError(f"{path}: the folder of boxes holds no file like NAME_1.txt.")
    file, names = names_beside(folder, film.path)
    first = 0 if 0 in files else 1
    rows = [
        (frame - first, f"{text}, line {n}", line.split())
        for frame, text in files.items()
        for n, line in enumerate(read_text(text).splitlines(), 1)
        if line.strip()
    ]
    tracks = _has_tracks(rows)
    found = [_yolo_box(film, *row, first, names, file, tracks) for row in rows]
    _require_a_text_a_frame(path, film, files, first)
    return checked(found, path, film)


def _require_a_text_a_frame(path: Path, film: Film, files: dict[int, Path], first: int) -> None:
    """Raises DemoError if one text has all frames, or texts are numbered without their step."""
    total, file = len(film.times), next(iter(files.values()))
    if len(files) == 1 and total > 1:
        raise DemoError(
            f"{file}: this is the only text of {film.path.name}, which has {total} frames, but "
            "there must be a text a frame, whose name ends with the frame's number."
        )
    last = re.sub(r"\d+$", str(total - 1 + first), file.stem)
    frames = (number_ - first for number_ in files)
    require_whole(path, film, frames, f"add an empty text of the last frame, {last}.txt")


def _has_tracks(rows: list[tuple[int, str, list[str]]]) -> bool:
    """True if the one further column is an identity: whole numbers, and not a confidence of 1."""
    further = [(frame, cells[0], cells[5]) for frame, _, cells in rows if len(cells) == 6]
    certain = {one for *_, one in further} == {"1"} and len({*further}) < len(further)
    return not certain and all(_TRACK.fullmatch(one) for *_, one in further)


def _yolo_box(film, frame, where, cells, first, names, file, tracks) -> Box:
    turned = len(cells) == 7 and not _TRACK.fullmatch(cells[6])
    if turned or (len(cells) > 7 and len(cells) % 2):
        raise DemoError(
            f"{where}: {len(cells)} columns are a polygon or a turned box in a box's place; there "
            "must be class, centre_x, centre_y, width, height, and at most confidence and track."
        )
    if len(cells) not in (5, 6, 7):
        raise DemoError(
            f"{where}: {len(cells)} columns, but there must be class, centre_x, centre_y, width, "
            "height, and at most confidence and track."
        )
    name = named(whole(cells[0], "class", where, least=0), 0, names, file, where)
    x, y, width, height = (number(cell, "a length", where) for cell in cells[1:5])
    if max(map(abs, (x, y, width, height))) > 2:
        raise DemoError(f"{where}: lengths must be shares of the picture, from 0 to 1.")
    edges = (
        (x - width / 2) * film.width, (y - height / 2) * film.height,
        (x + width / 2) * film.width, (y + height / 2) * film.height,
    )  # fmt: skip
    track = cells[6] if len(cells) == 7 else cells[5] if len(cells) == 6 and tracks else None
    sure = cells[5] if len(cells) == 7 or (len(cells) == 6 and not tracks) else 1.0
    return box(film, frame, name, edges, where, confidence=sure, track=track, first=first)
