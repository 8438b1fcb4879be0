"""Demonstrations on disk: a folder with a readable header, one video and one tracks file each.

    demos.json   task, class names, half_extent, fps, source, an entry for each demonstration; newer
                 sets also have robots, unit, noise and smoothing (`DemoSet`)
    000.mp4      its frames, as far as something still happens
    000.npz      its boxes: center (T, N, 2), size (T, N, 2), label (N,), seen (T, N)

T is frames, N objects; positions and sizes are in world units. A folder appears whole or not at
all, and is checked against its digests whenever it is loaded.
"""

import json
import os
import pathlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import jax
import numpy as np
from jaxtyping import UInt8

from gril_jax.demos.vision.detect import Tracks
from gril_jax.demos.vision.video import read_video
from gril_jax.errors import DemoError
from gril_jax.types import DemoBatch, VideoBatch

from .plain_npz import NotPlainError, read_plain
from .schema import DTYPES, HEADER, DemoEntry, check_header, check_tracks, digest
from .writer import Demo as Demo
from .writer import save_demo_set as save_demo_set

# Classes that are parts of a robot, of a set that does not say which are.
ROBOTS = ("robot", "left finger", "right finger", "hand")
_MARGIN = 5  # frames kept after the first in which all blocks have arrived
_MOVING = 0.01  # world units from its final place: an object nearer than this has arrived


@dataclass(frozen=True)
class DemoSet:
    """A loaded folder: header, entries and tracks; videos stay on disk."""

    folder: pathlib.Path
    task: str  # its name; empty where there is none
    classes: tuple[str, ...]  # a label is an index into them
    half_extent: float  # world units: half the width of the world that a frame shows
    fps: float
    source: str  # where the videos came from, in words
    entries: tuple[DemoEntry, ...]
    tracks: tuple[Tracks, ...]  # one an entry
    robots: tuple[str, ...] = ROBOTS  # classes that are parts of a robot, or of a person
    unit: str | None = None  # of lengths, in words; None where an older set does not say
    noise: float | None = None  # jitter of a detected centre along one axis, in that unit
    smoothing: int = 1  # frames of the running median that such jitter calls for

    @property
    def about(self) -> dict[str, Any]:
        """The arguments of `save_demo_set` beside the demonstrations."""
        names = "task classes half_extent fps source robots unit noise smoothing"
        return {name: getattr(self, name) for name in names.split()}


def trim_static_tail(
    tracks: Tracks,
    classes: Sequence[str],
    *,
    robots: Sequence[str] = ROBOTS,
    moving: float = _MOVING,
) -> int:
    """The number of frames to keep: all in which a block is still on its way, and a few more.

    Many equal frames at the end would carry different times, which temporal cycle-consistency
    can only fit by chance. Robot and goal do not count. At least 6 frames are kept if there are.
    A block has arrived once it stays within `moving` of its last place, in the set's unit.
    """
    kinds = [classes[label] for label in tracks.label]
    blocks = [i for i, kind in enumerate(kinds) if kind not in ("goal", *robots)]
    away = np.linalg.norm(tracks.center[:, blocks] - tracks.center[-1:, blocks], axis=-1)
    travelling = np.flatnonzero((away > moving).any(axis=1))
    arrived = int(travelling[-1]) + 1 if len(travelling) else 0
    return min(len(tracks.center), arrived + 1 + _MARGIN)


def load_demo_set(folder: str | os.PathLike) -> DemoSet:
    """Reads a demo set; a DemoError for what is missing, was changed, or breaks the schema."""
    folder = pathlib.Path(folder)
    try:
        header = json.loads((folder / HEADER).read_text(encoding="utf-8"))
    except OSError as error:
        raise DemoError(f"{folder / HEADER}: no demo set here ({error.strerror}).") from error
    except (ValueError, RecursionError) as error:
        raise DemoError(f"{folder / HEADER}: not a JSON file ({error}).") from error
    entries = check_header(header, folder)
    return DemoSet(
        folder=folder,
        task=header["task"],
        classes=tuple(header["classes"]),
        half_extent=float(header["half_extent"]),
        fps=float(header["fps"]),
        source=header["source"],
        entries=entries,
        tracks=tuple(_load_tracks(folder, entry, header["classes"]) for entry in entries),
        robots=tuple(header.get("robots", [n for n in ROBOTS if n in header["classes"]])),
        unit=header.get("unit"),
        noise=header.get("noise"),
        smoothing=header.get("smoothing", 1),
    )


def _load_tracks(folder: pathlib.Path, entry: DemoEntry, classes: list[str]) -> Tracks:
    for file, expected in ((entry.video, entry.video_sha256), (entry.tracks, entry.tracks_sha256)):
        if not (folder / file).is_file():
            raise DemoError(f"{folder / file}: the file of {entry.name!r} is missing.")
        if digest(folder / file) != expected:
            raise DemoError(
                f"{folder / file}: the contents differ from the digest in {HEADER}; "
                "the file was changed or damaged after it was saved."
            )
    path = folder / entry.tracks
    try:
        arrays = read_plain(path, Tracks._fields)
    except NotPlainError as error:
        raise DemoError(f"{path}: {error}.") from error
    if missing := set(DTYPES) - set(arrays):
        raise DemoError(f"{path}: the array {sorted(missing)[0]!r} is missing.")
    tracks = Tracks(**arrays)
    check_tracks(tracks, entry.frames, len(entry.objects), classes, str(path))
    if [classes[label] for label in tracks.label] != entry.objects:
        raise DemoError(f"{path}: label does not agree with the objects that {HEADER} lists.")
    return tracks


def select_objects(demo_set: DemoSet, objects: Sequence[str]) -> DemoSet:
    """The same demonstrations with only the named objects, trimmed to the end of their motion; a
    DemoError if one lacks an object.

    A task with fewer blocks than a video shows can so learn from it. Files stay as they are.
    """
    entries, tracks = [], []
    for entry, track in zip(demo_set.entries, demo_set.tracks, strict=True):
        if missing := [name for name in objects if name not in entry.objects]:
            raise DemoError(
                f"{demo_set.folder}: {entry.name!r} shows {', '.join(entry.objects)}, but the "
                f"task also has {missing[0]}."
            )
        keep = [i for i, name in enumerate(entry.objects) if name in objects]
        track = track.of(keep)
        frames = entry.frames
        if len(keep) < len(entry.objects):
            frames = trim_static_tail(track, demo_set.classes, robots=demo_set.robots)
            track = track.during(slice(frames))
        tracks.append(track)
        trimmed, names = entry.trimmed + entry.frames - frames, [entry.objects[i] for i in keep]
        entries.append(replace(entry, frames=frames, trimmed=trimmed, objects=names))
    return replace(demo_set, entries=tuple(entries), tracks=tuple(tracks))


def demo_batch(demo_set: DemoSet, names: Sequence[str] | None = None) -> DemoBatch:
    """Demonstrations as arrays, padded to the longest with their last frames; all without `names`.

    Objects are ordered by label, those of one label by their x in the first frame; a DemoError if
    they differ between demonstrations. One that a demonstration never shows is padding there.
    """
    names = [entry.name for entry in demo_set.entries] if names is None else list(names)
    if not names:
        raise DemoError(f"{demo_set.folder}: a batch needs at least 1 demonstration, got none.")
    tracks = _named(demo_set, names, demo_set.tracks)
    tracks = [track.of(np.lexsort((track.center[0, :, 0], track.label))) for track in tracks]
    for name, track in zip(names, tracks, strict=True):
        if not np.array_equal(track.label, tracks[0].label):
            objects = [", ".join(demo_set.classes[i] for i in t.label) for t in (tracks[0], track)]
            raise DemoError(
                f"{demo_set.folder}: all demonstrations of a batch must hold the same objects, "
                f"but {names[0]!r} has {objects[0]} and {name!r} has {objects[1]}."
            )
    label = np.stack([track.label for track in tracks])
    robot = [i for i, name in enumerate(demo_set.classes) if name in demo_set.robots]
    batch = DemoBatch(
        center=padded([track.center for track in tracks]),
        size=padded([track.size for track in tracks]),
        label=label,
        is_robot=np.isin(label, robot),
        present=np.stack([track.seen.any(axis=0) for track in tracks]),
        length=np.array([len(track.center) for track in tracks], np.int32),
    )
    return jax.device_put(batch)  # which compiles nothing, as `jnp.asarray` does for each shape


def padded(arrays: Sequence[np.ndarray]) -> np.ndarray:
    """Arrays of several lengths as one, each held at its last entry to the longest's length."""
    longest = max(map(len, arrays))
    return np.stack([a[np.minimum(np.arange(longest), len(a) - 1)] for a in arrays])


def frame_batch(
    demo_set: DemoSet, names: Sequence[str], *, pixels: int, half_extent: float | None = None
) -> VideoBatch:
    """The frames of some demonstrations as small squares, padded as `demo_batch` pads their boxes.

    They show the world as far as `half_extent`, or the set's own. One video at a time is decoded; a
    DemoError if it is damaged, not square, or not as long as its boxes.
    """
    zoom = 1.0 if half_extent is None else half_extent / demo_set.half_extent
    videos = []
    for entry in _named(demo_set, names, demo_set.entries):
        path = demo_set.folder / entry.video
        frames = read_video(path)
        count, height, width, _ = frames.shape
        if count != entry.frames:
            raise DemoError(
                f"{path}: holds {count} frames, but its boxes are those of {entry.frames}."
            )
        if height != width:
            raise DemoError(f"{path}: frames are {width} x {height}, but must be square.")
        videos.append(shrink(frames, pixels, zoom=zoom))
    return VideoBatch(padded(videos), np.array([len(frames) for frames in videos], np.int32))


def shrink(
    frames: UInt8[np.ndarray, "T S S 3"], pixels: int, *, zoom: float = 1.0
) -> UInt8[np.ndarray, "T P P 3"]:
    """Frames resized by area, of which a square of `zoom` times their side is shown: above 1 the
    outermost pixels go on."""
    margin = round((zoom - 1.0) * frames.shape[1] / 2)
    if margin < 0:
        frames = frames[:, -margin:margin, -margin:margin]
    border = (max(margin, 0),) * 4
    wider = (cv2.copyMakeBorder(frame, *border, cv2.BORDER_REPLICATE) for frame in frames)
    size = (pixels, pixels)
    return np.stack([cv2.resize(frame, size, interpolation=cv2.INTER_AREA) for frame in wider])


def _named(demo_set: DemoSet, names: Sequence[str], values: Sequence[Any]) -> list[Any]:
    """The values of the demonstrations of these names, out of one value for each of the set."""
    known = {entry.name: value for entry, value in zip(demo_set.entries, values, strict=True)}
    if unknown := [name for name in names if name not in known]:
        raise DemoError(
            f"{demo_set.folder}: there is no demonstration {unknown[0]!r}; there are "
            f"{', '.join(known)}."
        )
    return [known[name] for name in names]
