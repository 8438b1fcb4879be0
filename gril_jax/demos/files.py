"""The folder of a demo set, written complete or not at all, read by digests and schema.

Npz files are read with care, since they may be malicious.
"""

import functools
import json
import os
import pathlib
import re
import shutil
import tempfile
import zipfile
import zlib
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from gril_jax.errors import DemoError
from gril_jax.safe_files import cause

from .demo import Demo, Frames, Source, Tracks
from .folders import left_by_system
from .schema import (
    ABOUT,
    DTYPES,
    HEADER,
    OUTCOMES,
    SCHEMA_VERSION,
    check_header,
    check_tracks,
    digest,
    robots_among,
)
from .vision.video import read_video, write_video

NOTES = "import.txt"
_SOURCE = ("source_frame", "source_time")  # of the imported video, if it was resampled
_USUAL = {"robots": None, "unit": None, "noise": None, "smoothing": 1}
_OURS = re.compile(r"demos\.json|\d{3,}\.(mp4|npz)|import\.(txt|png)")  # names of a set's files
_MAX_BYTES = 1 << 30  # of the arrays, unpacked: a demonstration's have a few megabytes
# What NumPy and zipfile raise over bytes that are no npz file.
_NO_ARRAYS = (OSError, ValueError, EOFError, TypeError, AttributeError, LookupError, SyntaxError,
              NotImplementedError, RuntimeError, MemoryError, OverflowError, zipfile.BadZipFile,
              zlib.error)  # fmt: skip


def write_demo_set(
    folder: str | os.PathLike,
    demos: Iterable[Demo],
    *,
    notes: str = "",
    **about: Any,
) -> None:
    """Writes a demo set to a new or empty folder, or in place of an older set once it is complete.

    Demonstrations are consumed one at a time, so that a generator need hold only one video.
    `about` are the other fields of a `DemoSet`; robots, unit, noise and smoothing may be left out.

    Raises:
      DemoError: the folder holds something else, also beside an older set, a demonstration is
        malformed, there is none, or the disk is full.
    """
    folder, part = pathlib.Path(folder), None
    about = _USUAL | about
    if odd := {*about} - {*ABOUT}:
        raise TypeError(f"a demo set has no field {min(odd)!r}")
    classes, robots = list(about["classes"]), about["robots"]
    robots = robots_among(classes) if robots is None else robots
    about |= {"classes": classes, "robots": list(robots)}
    if folder.exists() and not folder.is_dir():
        raise DemoError(f"{folder}: this is a file; a demo set needs a folder.")
    held = [p.name for p in folder.iterdir()] if folder.is_dir() else []
    held = [name for name in held if not left_by_system(name)]
    if held and not (folder / HEADER).is_file():
        raise DemoError(
            f"{folder}: the folder is not empty and no demo set ({HEADER} is missing), "
            "so it was left alone; name a new or empty folder."
        )
    if more := [name for name in held if not _OURS.fullmatch(name)]:
        raise DemoError(
            f"{folder}: beside a demo set the folder holds {min(more)!r}, which would be lost, so "
            "it was left alone; name a new or empty folder."
        )
    where, folder = folder, folder.resolve()  # what a link leads to is replaced, the link stays
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        part = pathlib.Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
        part.chmod(0o755)
        given = (classes, about["fps"], about["half_extent"])
        entries = [_write(part, str(where), i, demo, *given) for i, demo in enumerate(demos)]
        if not entries:
            raise DemoError(f"{folder}: a demo set needs at least 1 demonstration, got none.")
        header = {"schema_version": SCHEMA_VERSION} | {name: about[name] for name in ABOUT}
        header["demos"] = entries
        if notes:
            (part / NOTES).write_text(notes, encoding="utf-8")
        (part / HEADER).write_text(json.dumps(header, indent=2) + "\n")
        check_header(header, folder)
        _move_into_place(part, folder)
    except OSError as error:
        raise DemoError(
            f"{folder}: the demo set could not be written because {cause(error)}."
        ) from error
    finally:
        if part is not None:
            shutil.rmtree(part, ignore_errors=True)


def _move_into_place(part: pathlib.Path, folder: pathlib.Path) -> None:
    if not folder.exists():
        part.rename(folder)
        return
    old = part.with_name(part.name + ".old")
    folder.rename(old)
    try:
        part.rename(folder)
    except OSError:
        old.rename(folder)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _write(
    part: pathlib.Path,
    where: str,
    number: int,
    demo: Demo,
    classes: Sequence[str],
    fps: float,
    half_extent: float,
) -> dict[str, Any]:
    """Writes the files of a demonstration; returns its entry in the header."""
    where = f"{where}, demonstration {demo.name!r}"
    if demo.outcome not in OUTCOMES:
        raise DemoError(f"{where}: outcome {demo.outcome!r} is not one of {', '.join(OUTCOMES)}.")
    frames = demo.frames
    objects = len(demo.tracks.label)
    check_tracks(demo.tracks, len(frames), objects, classes, half_extent, where)
    video, tracks = f"{number:03d}.mp4", f"{number:03d}.npz"
    write_video(part / video, frames, fps)
    source = {} if demo.source is None else dict(zip(_SOURCE, demo.source, strict=True))
    np.savez_compressed(part / tracks, **demo.tracks._asdict(), **source)
    return {
        "name": demo.name,
        "video": video,
        "tracks": tracks,
        "frames": len(frames),
        "trimmed": demo.trimmed,
        "outcome": demo.outcome,
        "objects": [classes[label] for label in demo.tracks.label],
        "video_sha256": digest(part / video),
        "tracks_sha256": digest(part / tracks),
    } | ({"stages": dict(demo.stages)} if demo.stages else {})


def read_header(folder: pathlib.Path) -> dict[str, Any]:
    """The checked header of a set; a DemoError for what is missing or breaks the schema."""
    try:
        header = json.loads((folder / HEADER).read_text(encoding="utf-8"))
    except OSError as error:
        raise DemoError(f"{folder / HEADER}: no demo set here ({error.strerror}).") from error
    except (ValueError, RecursionError) as error:
        raise DemoError(f"{folder / HEADER}: not a JSON file ({error}).") from error
    return check_header(header, folder)


def read_demo(
    folder: pathlib.Path, entry: dict[str, Any], classes: list[str], half_extent: float
) -> Demo:
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
        arrays = read_plain(path, (*Tracks._fields, *_SOURCE))
    except NotPlainError as error:
        raise DemoError(f"{path}: {error}.") from error
    if missing := set(DTYPES) - set(arrays):
        raise DemoError(f"{path}: the array {sorted(missing)[0]!r} is missing.")
    source = [arrays.pop(name, None) for name in _SOURCE]
    tracks = Tracks(**arrays)
    objects = len(entry["objects"])
    check_tracks(tracks, entry["frames"], objects, classes, half_extent, str(path))
    if [classes[label] for label in tracks.label] != entry["objects"]:
        raise DemoError(f"{path}: label does not agree with the objects that {HEADER} lists.")
    video = functools.partial(_video, folder / entry["video"], entry["frames"])
    about = {name: entry.get(name) for name in ("trimmed", "outcome", "stages")}
    return Demo(
        entry["name"], video, tracks, **about, source=_source(source, len(tracks.seen), path)
    )


def _source(arrays: Sequence[Any], frames: int, path: pathlib.Path) -> Source | None:
    """The frames of the imported video; None if the set does not say, a DemoError if they cannot
    be."""
    if all(array is None for array in arrays):
        return None
    frame, time = (np.zeros(0) if array is None else array for array in arrays)
    fits = frame.dtype == np.int32 and time.dtype == np.float64
    fits = fits and frame.shape == time.shape == (frames,) and np.isfinite(time).all()
    if not fits or (frame < 0).any() or (np.diff(frame) < 0).any() or (np.diff(time) < 0).any():
        raise DemoError(
            f"{path}: {' and '.join(_SOURCE)} must each be {frames} numbers that never decrease."
        )
    return Source(frame, time)


def _video(path: pathlib.Path, count: int) -> Frames:
    """The frames of a saved video, which must be as many as its boxes are of."""
    frames = read_video(path)
    if len(frames) != count:
        raise DemoError(f"{path}: holds {len(frames)} frames, but its boxes are those of {count}.")
    return frames


class NotPlainError(Exception):
    """The file holds no plain arrays; the text says what is wrong, without the file's name."""


def read_plain(path: str | os.PathLike, names: Iterable[str]) -> dict[str, np.ndarray]:
    """Those of the named arrays that the file has; nothing is unpickled. A NotPlainError if the
    file is damaged, holds objects, is no regular file, or unpacks to more than 1 GiB."""
    if not os.path.isfile(path):  # reading from a pipe would wait for ever
        raise NotPlainError("not an npz file of plain arrays")
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > _MAX_BYTES:
            raise NotPlainError("unpacks to more than 1 GiB")
        with np.load(path, allow_pickle=False) as file:
            found = {name: file[name] for name in names if name in file.files}
    except _NO_ARRAYS as error:
        raise NotPlainError("not an npz file of plain arrays") from error
    if not all(isinstance(array, np.ndarray) for array in found.values()):  # one without header
        raise NotPlainError("not an npz file of plain arrays")
    return found
