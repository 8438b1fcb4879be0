"""The schema of a demo set's header and arrays, version 1, and its checks."""

import hashlib
import pathlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gril_jax.demos.vision.detect import Tracks
from gril_jax.errors import DemoError

HEADER = "demos.json"
SCHEMA_VERSION = 1
_LONGEST = 255  # bytes of a file's name, on every usual file system
OUTCOMES = ("success", "failure", "unknown")
DTYPES = {"center": np.float32, "size": np.float32, "label": np.int32, "seen": np.bool_}
_FIELDS = {
    "task": str, "classes": list, "half_extent": float, "fps": float, "source": str, "demos": list,
}  # fmt: skip


@dataclass(frozen=True)
class DemoEntry:
    """The header's entry of one demonstration."""

    name: str
    video: str  # file name in the folder
    tracks: str
    frames: int
    trimmed: int
    outcome: str
    objects: list[str]  # class names, in the order of the tracks
    video_sha256: str
    tracks_sha256: str
    # Frame at which each stage of the task was first finished, -1 never; None: not known.
    stages: dict[str, int] | None = None


# What every entry has. Stages came later: a set without them is read, and older readers skip them.
_ENTRY = {field: kind for field, kind in DemoEntry.__annotations__.items() if field != "stages"}


def check_header(header: object, folder: pathlib.Path) -> tuple[DemoEntry, ...]:
    """The entries of a header; raises `DemoError` with the name of the wrong field."""
    where = folder / HEADER
    version = header.get("schema_version") if isinstance(header, dict) else None
    if type(version) is not int or version < 1:
        raise DemoError(f"{where}: schema_version must be {SCHEMA_VERSION}, not {version!r}.")
    if version > SCHEMA_VERSION:
        raise DemoError(
            f"{where}: schema_version is {version}, newer than the {SCHEMA_VERSION} that this "
            "version of gril-jax reads; update gril-jax."
        )
    _check_fields(header, _FIELDS, f"{where}")
    for field in ("half_extent", "fps"):
        if not 0 < header[field] < 1e30:  # beyond it, a whole number may be no float
            raise DemoError(f"{where}: {field} must be above 0, not {header[field]!s:.60}.")
    if not all(isinstance(name, str) for name in header["classes"]):
        raise DemoError(f"{where}: classes must be a list of names.")
    if "robots" in header:
        _check_fields(header, {"robots": list}, f"{where}")
        for name in header["robots"]:
            if name not in header["classes"]:
                raise DemoError(f"{where}: robots has {name!r:.60}, which is none of the classes.")
    if not header["demos"]:
        raise DemoError(f"{where}: demos is empty; a demo set needs at least 1 demonstration.")
    entries = [
        _entry(entry, header["classes"], f"{where}, demos[{i}]")
        for i, entry in enumerate(header["demos"])
    ]
    names = [entry.name for entry in entries]
    for name in names:
        if names.count(name) > 1:
            raise DemoError(f"{where}: two demonstrations are called {name!r}; names must differ.")
    return tuple(entries)


def _check_fields(holder: object, fields: dict[str, object], where: str) -> None:
    if not isinstance(holder, dict):
        raise DemoError(f"{where}: must be an object with fields, not {type(holder).__name__}.")
    for field, kind in fields.items():
        if field not in holder:
            raise DemoError(f"{where}: the field {field!r} is missing.")
        kind = list if kind == list[str] else kind
        value = holder[field]
        number = kind is float and isinstance(value, int)
        _check_text(value, f"{where}: {field}")
        if isinstance(value, bool) or not (number or isinstance(value, kind)):
            raise DemoError(f"{where}: {field} must be {kind.__name__}, not {value!r:.60}.")


def _check_text(value: object, where: str) -> None:
    """Raises `DemoError` for names that no file and no page could hold: JSON may have half a
    letter."""
    for text in value if isinstance(value, list) else [value]:
        try:
            _ = isinstance(text, str) and text.encode()
        except UnicodeEncodeError:
            raise DemoError(f"{where} must be text, not {text!r:.60}.") from None


def _entry(fields: object, classes: list[str], where: str) -> DemoEntry:
    _check_fields(fields, _ENTRY, where)
    _check_stages(stages := fields.get("stages"), where)
    entry = DemoEntry(**{field: fields[field] for field in _ENTRY}, stages=stages)
    for file in (entry.video, entry.tracks):
        plain = pathlib.PurePath(file).name == file != ".." and not {"\\", "\0"} & {*file}
        if not plain or len(file.encode()) > _LONGEST:
            raise DemoError(f"{where}: {file!r:.60} must be a plain file name within the folder.")
    if entry.outcome not in OUTCOMES:
        raise DemoError(f"{where}: outcome must be one of {', '.join(OUTCOMES)}.")
    if entry.trimmed < 0:
        raise DemoError(f"{where}: trimmed must be at least 0, not {entry.trimmed}.")
    if entry.frames < 2:
        raise DemoError(f"{where}: a demonstration needs at least 2 frames, not {entry.frames}.")
    for name in entry.objects:
        if name not in classes:
            raise DemoError(f"{where}: the object {name!r} is not one of the set's classes.")
    return entry


def _check_stages(stages: object, where: str) -> None:
    if stages is not None and not (stages and isinstance(stages, dict)):
        raise DemoError(f"{where}: stages must give each stage's frame by its name.")
    for name, frame in (stages or {}).items():
        if type(frame) is not int or frame < -1:
            raise DemoError(f"{where}: stage {name!r} must have a frame or -1, not {frame!r:.60}.")


def check_tracks(
    tracks: Tracks, frames: int, objects: int, classes: Sequence[str], where: str
) -> None:
    """Raises `DemoError` unless the arrays have the schema's shapes, types and ranges."""
    if frames < 2:
        raise DemoError(f"{where}: a demonstration needs at least 2 frames, not {frames}.")
    seen = (frames, objects)
    shapes = ((*seen, 2), (*seen, 2), (objects,), seen)
    for (field, kind), shape in zip(DTYPES.items(), shapes, strict=True):
        array = getattr(tracks, field)
        if array.shape != shape or array.dtype != kind:
            raise DemoError(
                f"{where}: {field} is {array.dtype} {array.shape}, it must be "
                f"{np.dtype(kind)} {shape}."
            )
    if not (np.isfinite(tracks.center).all() and np.isfinite(tracks.size).all()):
        raise DemoError(f"{where}: center and size must be finite numbers.")
    if (tracks.size <= 0).any():
        raise DemoError(f"{where}: size must be above 0 for every object in every frame.")
    if ((tracks.label < 0) | (tracks.label >= len(classes))).any():
        raise DemoError(
            f"{where}: label must lie in 0 to {len(classes) - 1}, the {len(classes)} classes."
        )


def digest(path: pathlib.Path) -> str:
    """The SHA-256 of a file's contents, in hexadecimal."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
