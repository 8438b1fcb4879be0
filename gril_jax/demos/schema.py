"""The schema of a demo set's header and arrays, version 1, and its checks."""

import hashlib
import pathlib
from collections.abc import Mapping, Sequence, Set
from typing import Any

import numpy as np

from gril_jax.errors import DemoError, is_printable

from .demo import Tracks

HEADER = "demos.json"
SCHEMA_VERSION = 1
_FAR = 20.0  # half extents of a frame: ten pictures' widths
_LONGEST = 255  # bytes of a file's name, on every usual file system
OUTCOMES = ("success", "failure", "unknown")
DTYPES = {"center": np.float32, "size": np.float32, "label": np.int32, "seen": np.bool_}
_FIELDS = {
    "task": str, "classes": list, "half_extent": float, "fps": float, "source": str, "robots": list,
    "unit": str | None, "noise": float | None, "smoothing": int, "demos": list,
}  # fmt: skip
ABOUT = tuple(name for name in _FIELDS if name != "demos")  # of `DemoSet`, too
_ENTRY = {
    "name": str,
    "video": str,  # file name in the folder
    "tracks": str,
    "frames": int,
    "trimmed": int,
    "outcome": str,
    "objects": list,  # class names, in the order of the tracks
    "video_sha256": str,
    "tracks_sha256": str,
}  # and "stages" where they are known, see `Demo`
NO_TASK = ""  # of a set of somebody's own videos


# Classes that are parts of a robot, of a set that does not say which are.
ROBOTS = ("robot", "left finger", "right finger", "hand")


def robots_among(classes: Sequence[str]) -> tuple[str, ...]:
    """Those of the classes that are parts of a robot by their names."""
    return tuple(name for name in ROBOTS if name in classes)


def check_header(header: object, folder: pathlib.Path) -> dict[str, Any]:
    """The header; raises `DemoError` with the name of the wrong field."""
    where = folder / HEADER
    version = header.get("schema_version") if isinstance(header, dict) else None
    if type(version) is not int or version != SCHEMA_VERSION:
        raise DemoError(f"{where}: schema_version must be {SCHEMA_VERSION}, not {version!r:.60}.")
    _check_fields(header, _FIELDS, f"{where}")
    for field in ("half_extent", "fps"):
        if not 0 < header[field] < 1e30:  # beyond it, a whole number may be no float
            raise DemoError(f"{where}: {field} must be above 0, not {header[field]!s:.60}.")
    for field in ("classes", "robots"):
        if (twice := _repeated(header[field], f"{where}: {field}")) is not None:
            raise DemoError(f"{where}: {field} names {twice!r:.60} twice; names must differ.")
    known = {*header["classes"]}
    if stray := [name for name in header["robots"] if name not in known]:
        raise DemoError(f"{where}: robots names {stray[0]!r:.60}, which is not one of the classes.")
    if not 0 <= (header["noise"] or 0.0) < 1e30:
        raise DemoError(f"{where}: noise must be at least 0, not {header['noise']!s:.60}.")
    if not 1 <= header["smoothing"] < 100 or header["smoothing"] % 2 == 0:
        raise DemoError(f"{where}: smoothing must be odd and from 1 to 99.")
    if not header["demos"]:
        raise DemoError(f"{where}: demos is empty; a demo set needs at least 1 demonstration.")
    for i, entry in enumerate(header["demos"]):
        _check_entry(entry, known, f"{where}, demos[{i}]")
    twice = _repeated([entry["name"] for entry in header["demos"]], f"{where}: names")
    if twice is not None:
        raise DemoError(f"{where}: two demonstrations are called {twice!r:.60}; names must differ.")
    return header


def _repeated(names: list[Any], where: str) -> str | None:
    """The first name that is there twice; a DemoError if one is no name."""
    seen: set[str] = set()
    for name in names:
        if not is_printable(name) or not name.strip():
            raise DemoError(f"{where} must be a list of names in printable letters.")
        if name in seen:
            return name
        seen.add(name)
    return None


def _check_fields(holder: object, fields: dict[str, Any], where: str) -> None:
    if not isinstance(holder, dict):
        raise DemoError(f"{where}: must be an object with fields, not {type(holder).__name__}.")
    lists = [value if isinstance(value, list) else [value] for value in holder.values()]
    # All at once: a set may have thousands of entries.
    plain = is_printable("".join(text for one in lists for text in one if isinstance(text, str)))
    for field, kind in fields.items():
        if field not in holder:
            raise DemoError(f"{where}: the field {field!r} is missing.")
        value = holder[field]
        number = isinstance(0.0, kind) and isinstance(value, int)
        if not plain:
            _check_text(value, f"{where}: {field}")
        if isinstance(value, bool) or not (number or isinstance(value, kind)):
            named = getattr(kind, "__name__", str(kind))
            raise DemoError(f"{where}: {field} must be {named}, not {value!r:.60}.")


def _check_text(value: object, where: str) -> None:
    """Raises `DemoError` for text that no page could hold and a terminal would obey."""
    for text in value if isinstance(value, list) else [value]:
        if isinstance(text, str) and not is_printable(text):
            raise DemoError(f"{where} must be text in printable letters, not {text!r:.60}.")


def _check_entry(entry: object, classes: Set[str], where: str) -> None:
    _check_fields(entry, _ENTRY, where)
    _check_stages(entry.get("stages"), where)
    for file in (entry["video"], entry["tracks"]):
        plain = pathlib.PurePath(file).name == file != ".." and not {"\\", "\0"} & {*file}
        if not plain or len(file.encode()) > _LONGEST:
            raise DemoError(f"{where}: {file!r:.60} must be a plain file name within the folder.")
    if entry["outcome"] not in OUTCOMES:
        raise DemoError(f"{where}: outcome must be one of {', '.join(OUTCOMES)}.")
    if entry["trimmed"] < 0:
        raise DemoError(f"{where}: trimmed must be at least 0, not {entry['trimmed']}.")
    if entry["frames"] < 2:
        raise DemoError(f"{where}: a demonstration needs at least 2 frames, not {entry['frames']}.")
    for name in entry["objects"]:
        if not isinstance(name, str) or name not in classes:
            raise DemoError(f"{where}: the object {name!r:.60} is not one of the set's classes.")


def _check_stages(stages: object, where: str) -> None:
    if stages is not None and not (stages and isinstance(stages, dict)):
        raise DemoError(f"{where}: stages must give each stage's frame by its name.")
    for name, frame in (stages or {}).items():
        _check_text(name, f"{where}: stages")
        if type(frame) is not int or frame < -1:
            raise DemoError(f"{where}: stage {name!r} must have a frame or -1, not {frame!r:.60}.")


def check_tracks(
    tracks: Tracks,
    frames: int,
    objects: int,
    classes: Sequence[str],
    half_extent: float,
    where: str,
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
    check_boxes(tracks, half_extent, where)
    if ((tracks.label < 0) | (tracks.label >= len(classes))).any():
        raise DemoError(
            f"{where}: label must lie in 0 to {len(classes) - 1}, the {len(classes)} classes."
        )


def outcomes(given: str | Mapping[str, str], names: Sequence[str]) -> dict[str, str]:
    """The outcome of each video by its name: the same for all, or those that are given; else
    "unknown". A DemoError for another word, or a name that no video has."""
    each = dict.fromkeys(names, given) if isinstance(given, str) else given
    for name, kind in each.items():
        if kind not in OUTCOMES:
            known = ", ".join(OUTCOMES)
            raise DemoError(f"outcome of {name} is {kind!r:.60}, but must be one of {known}.")
        if name not in names:
            raise DemoError(f"outcome is given for {name!r:.60}, but no video has that name.")
    return {name: each.get(name, "unknown") for name in names}


def check_boxes(tracks: Tracks, half_extent: float, where: str) -> None:
    """Raises `DemoError` for numbers that cannot be boxes in frames that show `half_extent` to each
    side."""
    if not (np.isfinite(tracks.center).all() and np.isfinite(tracks.size).all()):
        raise DemoError(f"{where}: center and size must be finite numbers.")
    if (tracks.size <= 0).any():
        raise DemoError(f"{where}: size must be above 0 for every object in every frame.")
    for field in ("center", "size"):
        array = np.abs(getattr(tracks, field))
        if (array > _FAR * half_extent).any():
            frame, number = np.argwhere(array == array.max())[0][:2]
            raise DemoError(
                f"{where}: {field} of object {number} in frame {frame} is {array.max():g}, but "
                f"must be at most {_FAR * half_extent:g}: a frame shows {half_extent:g} to each "
                "side."
            )


def digest(path: pathlib.Path) -> str:
    """The SHA-256 of a file's contents, in hexadecimal."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
