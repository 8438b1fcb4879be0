"""The videos of a user's folder, beside what systems leave there.

Passed over are hidden files, such as those beginning with `._` that a Mac writes to other disks.
A video that has not come yet is said, since a set without it would be another one.
"""

import os
import pathlib
import re
import unicodedata
from collections.abc import Sequence

from gril_jax.errors import DemoError

VIDEOS = (
    ".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi", ".gif", ".3gp", ".mpg", ".mpeg", ".ts",
    ".mts", ".m2ts", ".wmv", ".flv", ".ogv",
)  # fmt: skip
_PICTURES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")
_PACKED = (".zip", ".tar", ".gz", ".tgz", ".7z", ".rar")
_HIDDEN = re.compile(r"\.[^.]")
# What a browser, or a disk in a cloud, has in place of a file until it is there.
_COMING = re.compile(r"\.?(.+?)\.(part|crdownload|download|icloud)")
_SYSTEMS = re.compile(r"\._.*|\.DS_Store|Thumbs\.db|desktop\.ini")


def composed(text: str) -> str:
    """Text in the one Unicode form in which names are compared.

    >>> composed("Ku\\u0308che") == "Küche"
    True
    """
    return unicodedata.normalize("NFC", text)


def left_by_system(name: str) -> bool:
    """True for a file that a Mac or Windows leaves in a folder that it has shown."""
    return _SYSTEMS.fullmatch(name) is not None


def visible(folder: pathlib.Path, pattern: str) -> list[pathlib.Path]:
    """The paths of a folder that match a pattern and are not hidden, sorted by name."""
    return sorted(path for path in folder.glob(pattern) if not _HIDDEN.match(path.name))


def videos_in(folder: pathlib.Path, out: str | os.PathLike | None) -> list[pathlib.Path]:
    """The videos of a folder, sorted by name.

    Raises DemoError if there is none, if one is not there yet, if two have one name, or if the
    demo set would go into the folder itself."""
    if not folder.is_dir():
        is_file = " is a file; name the folder of the videos." if folder.exists() else ""
        raise DemoError(f"{folder}:{is_file or ' there is no such folder.'}")
    _require_all_here(folder)
    paths = _videos(folder)
    if not paths:
        raise DemoError(f"{folder}: the folder holds no video ({', '.join(VIDEOS)}){_near(folder)}")
    if out is not None and os.path.realpath(folder) == os.path.realpath(out):
        raise DemoError(f"{folder}: this folder is read, so the demo set must go to another one.")
    _require_names(paths)
    return paths


def _videos(folder: pathlib.Path) -> list[pathlib.Path]:
    return [path for path in visible(folder, "*") if path.suffix.lower() in VIDEOS]


def _require_all_here(folder: pathlib.Path) -> None:
    for path in sorted(folder.glob("*")):
        found = _COMING.fullmatch(path.name)
        if found and pathlib.Path(found[1]).suffix.lower() in VIDEOS:
            raise DemoError(
                f"{path}: {found[1]} is not here as a whole yet; wait for it, or remove this file."
            )


def _near(folder: pathlib.Path) -> str:
    """The end of a sentence on a folder without videos: where some are, one or two folders on."""
    for pattern in ("*/meta/info.json", "snapshots/*/meta/info.json"):  # as Hugging Face keeps them
        if found := next(iter(sorted(folder.glob(pattern))), None):
            return f"; a LeRobot dataset is in {found.parent.parent}, which must be named itself."
    inside = visible(folder, "*")
    for inner in inside:
        if inner.is_dir() and _videos(inner):
            return f"; there are videos in {inner}, which must be named itself."
    for path in [*inside, *(one for inner in inside for one in visible(inner, "*"))]:
        if path.suffix.lower() in _PACKED:
            return f"; {path} is packed, so unpack it."
        if path.suffix.lower() in _PICTURES:
            return f"; there are pictures in {path.parent}, of which FFmpeg can make a video."
    return "."


def _require_names(paths: Sequence[pathlib.Path]) -> None:
    stems = [composed(path.stem) for path in paths]
    for path in paths:
        if any("\ud800" <= letter <= "\udfff" for letter in path.name):
            named = str(path).encode(errors="backslashreplace").decode()
            raise DemoError(f"{named}: the file's name is not text in UTF-8; rename it.")
    for path in paths:
        if stems.count(composed(path.stem)) > 1:
            raise DemoError(f"{path}: two videos are called {path.stem!r}; names must differ.")
