"""The boxes beside a video, and their format, which is told from what is in them.

Beside NAME.mp4 boxes are NAME.csv, NAME.txt, NAME.xml, NAME.json, a folder NAME of one text a
frame, or NAME/gt/gt.txt. `annotations.json` or `annotations.xml` may hold those of all videos of a
folder.
"""

from collections.abc import Callable
from pathlib import Path

from gril_jax.errors import DemoError

from . import coco, cvat, label_studio, lines, table, yolo
from .names import there
from .record import Box, Film, read_text

Reader = Callable[[Path, Film], list[Box]]
"""(file, video) -> its boxes. What every format has."""

_BEGINS = {"<": cvat.read, "{": coco.read, "[": label_studio.read}
_SUFFIXES = (".csv", ".txt", ".xml", ".json")
_TOGETHER = ("annotations.json", "annotations.xml")
_PACKED = (".zip", ".gz", ".7z", ".tar", ".tar.gz", ".tgz", ".rar")
_HEAD = 4096  # letters from which a format is told


def boxes_of(film: Film) -> list[Box]:
    """The boxes beside a video; a DemoError if there are none, or their format is not known."""
    path = file_of(film.path)
    return reader(path)(path, film)


def file_of(film: Path) -> Path:
    """The file or folder of a video's boxes."""
    beside = [there(film.with_suffix(suffix)) for suffix in _SUFFIXES]
    folder = there(film.with_suffix(""))
    inside = folder / "gt" / "gt.txt"
    found = [path for path in beside if path.exists() or path.is_symlink()]
    if inside.exists():
        found.append(inside)
    elif folder.is_dir() and (yolo.is_folder(folder) or not found):  # not one of pictures
        found.append(folder)
    if not found:
        found = [path for name in _TOGETHER if (path := there(film.parent / name)).exists()]
    if not found:
        _require_unpacked(film)
        listed = ", ".join(path.name for path in beside)
        raise DemoError(
            f"{film}: no boxes are beside the video: they must be one of {listed}, a folder "
            f"{folder.name}, or {' or '.join(_TOGETHER)} of all videos."
        )
    if len(found) > 1:
        raise DemoError(
            f"{film}: both {found[0].name} and {found[1].name} are beside it, but its boxes "
            "must be in one place."
        )
    return found[0]


def _require_unpacked(film: Path) -> None:
    """Raises DemoError if the boxes are there, but packed."""
    names = [film.stem, *(film.stem + suffix for suffix in _SUFFIXES), film.name, "annotations",
             *_TOGETHER]  # fmt: skip
    for name in (name + ending for name in names for ending in _PACKED):
        if (path := there(film.parent / name)).exists():
            raise DemoError(f"{path}: the boxes of {film.name} are packed; unpack this file.")


def reader(path: Path) -> Reader:
    """The reader of a file's format."""
    if path.is_dir():
        return yolo.read
    head = read_text(path)[:_HEAD]
    if not head.strip():
        raise DemoError(f"{path}: the boxes file is empty.")
    if table.is_csv(head):
        return table.read_csv
    if known := _BEGINS.get(head.lstrip()[0]):
        return known
    if yolo.is_yolo(head):
        raise DemoError(
            f"{path}, line 1: this is YOLO text, whose boxes are of one frame, but there must be a "
            f"folder {path.stem} of a text a frame, whose name ends with the frame's number."
        )
    if lines.is_mot(head):
        return lines.read_mot
    raise DemoError(
        f"{path}, line 1: the format of the boxes is not known; it must be CSV with the columns "
        f"{','.join(table.COLUMNS)}, MOTChallenge text, CVAT for video, or JSON of COCO or "
        "Label Studio."
    )
