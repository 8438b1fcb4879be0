"""YOLO text: a folder NAME beside NAME.mp4 with a file a frame, whose name ends with its number.

    class centre_x centre_y width height [confidence] [track]

Lengths are shares of the picture; classes are numbers from 0 of the names file. Frames count from
1, or from 0 if there is a file of that number. One further column is a track if all its values are
whole numbers, else a confidence. A frame without a file, or with an empty one, shows nothing.
"""

import re
from pathlib import Path

from gril_jax.errors import DemoError

from .names import FILES, named, names_beside
from .record import Box, Film, box, checked, number, read_text, whole


def read(path: Path, film: Film) -> list[Box]:
    """The boxes of a folder."""
    folder = path / "labels" if (path / "labels").is_dir() else path
    files = {}
    for file in sorted(folder.glob("*.txt")):
        if file.name in FILES:
            continue
        ending = re.search(r"(\d+)$", file.stem)
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
    tracks = all(cells[5].isdigit() for _, _, cells in rows if len(cells) == 6)
    return checked([_box(film, *row, names, file, tracks) for row in rows], path, film)


def _box(film, frame, where, cells, names, file, tracks) -> Box:
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
    return box(film, frame, name, edges, where, confidence=sure, track=track)
