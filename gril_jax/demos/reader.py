"""Reads the files of a demo set, each checked against its digest and the schema."""

import functools
import json
import pathlib
from typing import Any

from gril_jax.demos.vision.video import read_video
from gril_jax.errors import DemoError

from .demo import Demo, Frames, Tracks
from .plain_npz import NotPlainError, read_plain
from .schema import DTYPES, HEADER, check_header, check_tracks, digest


def read_header(folder: pathlib.Path) -> dict[str, Any]:
    """The checked header of a set; a DemoError for what is missing or breaks the schema."""
    try:
        header = json.loads((folder / HEADER).read_text(encoding="utf-8"))
    except OSError as error:
        raise DemoError(f"{folder / HEADER}: no demo set here ({error.strerror}).") from error
    except (ValueError, RecursionError) as error:
        raise DemoError(f"{folder / HEADER}: not a JSON file ({error}).") from error
    return check_header(header, folder)


def read_demo(folder: pathlib.Path, entry: dict[str, Any], classes: list[str]) -> Demo:
    """One demonstration by its entry in the header; its video is read when it is asked for."""
    for file in ("video", "tracks"):
        path = folder / entry[file]
        if not path.is_file():
            raise DemoError(f"{path}: the file of {entry['name']!r} is missing.")
        if digest(path) != entry[f"{file}_sha256"]:
            raise DemoError(
                f"{path}: the contents differ from the digest in {HEADER}; "
                "the file was changed or damaged after it was saved."
            )
    path = folder / entry["tracks"]
    try:
        arrays = read_plain(path, Tracks._fields)
    except NotPlainError as error:
        raise DemoError(f"{path}: {error}.") from error
    if missing := set(DTYPES) - set(arrays):
        raise DemoError(f"{path}: the array {sorted(missing)[0]!r} is missing.")
    tracks = Tracks(**arrays)
    check_tracks(tracks, entry["frames"], len(entry["objects"]), classes, str(path))
    if [classes[label] for label in tracks.label] != entry["objects"]:
        raise DemoError(f"{path}: label does not agree with the objects that {HEADER} lists.")
    video = functools.partial(_video, folder / entry["video"], entry["frames"])
    about = {name: entry.get(name) for name in ("trimmed", "outcome", "stages")}
    return Demo(entry["name"], video, tracks, **about)


def _video(path: pathlib.Path, count: int) -> Frames:
    """The frames of a saved video, which must be as many as its boxes are of."""
    frames = read_video(path)
    if len(frames) != count:
        raise DemoError(f"{path}: holds {len(frames)} frames, but its boxes are those of {count}.")
    return frames
