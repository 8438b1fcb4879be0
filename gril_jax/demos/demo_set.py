"""Demonstrations of one task or scene, in memory or in a folder.

    demos.json   task, class names, half_extent, fps, source, robots, unit, noise and smoothing
                 (`DemoSet`), an entry for each demonstration
    000.mp4      its frames, as far as something still happens
    000.npz      its boxes: center (T, N, 2), size (T, N, 2), label (N,), seen (T, N); of an
                 imported video also the frames that it shows of it: source_frame, source_time (T,)
    import.txt   what an import found and repaired, if the set was imported

T is frames, N objects. A folder appears whole or not at all, and is checked against its digests
whenever it is loaded.
"""

import functools
import itertools
import math
import os
import pathlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import jax
import numpy as np
from jaxtyping import UInt8

from gril_jax.errors import DemoError
from gril_jax.runs.progress import Progress
from gril_jax.threads import parallel_map
from gril_jax.types import DemoBatch, VideoBatch

from .demo import Demo, trim_static_tail
from .files import read_demo, read_header, write_demo_set
from .schema import ABOUT, check_boxes, robots_among


@dataclass(frozen=True, repr=False)
class DemoSet:
    """Demonstrations and the words and units of their boxes; iterating gives each `Demo`.

    Two sets are equal if all is but their videos, folders and notes.

    >>> import numpy as np
    >>> from gril_jax.demos.demo import Tracks
    >>> place, seen = np.zeros((5, 1, 2), np.float32), np.ones((5, 1), bool)
    >>> cup = Tracks(place, place + 1, np.zeros(1, np.int32), seen)
    >>> demo = Demo("first", np.zeros((5, 8, 8, 3), np.uint8), cup)
    >>> demos = DemoSet((demo,), "tidy", ("cup",), half_extent=0.5, fps=10.0, source="by hand")
    >>> len(demos), demos.names, len(demos["first"]), demos.boxes.center.shape
    (1, ['first'], 5, (1, 5, 1, 2))
    >>> demos
    DemoSet(tidy: 1 demonstration of 5 frames, 10 a second; classes: cup)
    """

    demos: tuple[Demo, ...]
    task: str  # its name; empty where there is none
    classes: tuple[str, ...]  # a label is an index into them
    half_extent: float  # half the width of what a frame shows, in the set's unit
    fps: float  # frames a second
    source: str  # where the videos came from, in words
    robots: tuple[str, ...] | None = None  # classes of a robot or person; None: `ROBOTS` among them
    unit: str | None = None  # of lengths, in words; None where nobody says
    noise: float | None = None  # jitter of a detected centre along one axis, in that unit
    smoothing: int = 1  # frames of the running median that such jitter calls for
    folder: pathlib.Path | None = field(default=None, compare=False)  # None: in memory
    notes: str = field(default="", compare=False)  # what an import found and repaired: import.txt

    def __post_init__(self):
        if self.robots is None:
            object.__setattr__(self, "robots", robots_among(self.classes))
        for demo in self.demos if self.folder is None else ():
            check_boxes(demo.tracks, self.half_extent, f"{self.where}, {demo.name!r}")

    def __len__(self) -> int:
        return len(self.demos)

    def __iter__(self) -> Iterator[Demo]:
        return iter(self.demos)

    def __getitem__(self, key: int | str) -> Demo:
        """A demonstration by its place or its name; a DemoError if none has that name."""
        return self.select([key])[0] if isinstance(key, str) else self.demos[key]

    def __repr__(self) -> str:
        lengths = sorted({len(demo) for demo in self.demos}) or [0]
        frames = f"{lengths[0]}" if len(lengths) == 1 else f"{lengths[0]} to {lengths[-1]}"
        acting = [f"{name} (robot)" if name in self.robots else name for name in self.classes]
        return (
            f"DemoSet({self.task or 'no task'}: {len(self)} demonstration{'s'[: len(self) != 1]} "
            f"of {frames} frames, {self.fps:g} a second; classes: {', '.join(acting)})"
        )

    @property
    def names(self) -> list[str]:
        """The names of the demonstrations, in order."""
        return [demo.name for demo in self.demos]

    @property
    def where(self) -> str:
        """The folder, or where the videos came from: how errors begin."""
        return self.source if self.folder is None else str(self.folder)

    @property
    def boxes(self) -> DemoBatch:
        """All demonstrations as arrays (B, T, N, ...): `demo_batch` of the set."""
        return demo_batch(self)

    @property
    def about(self) -> dict[str, Any]:
        """All fields that a saved set has beside its demonstrations."""
        return {name: getattr(self, name) for name in ABOUT}

    def objects(self, demo: Demo) -> list[str]:
        """Class names of a demonstration's objects, in the order of its tracks."""
        return [self.classes[label] for label in demo.tracks.label]

    def select(self, names: Sequence[str]) -> tuple[Demo, ...]:
        """The demonstrations of these names, in this order; a DemoError if there is none."""
        known = self._by_name
        if unknown := [name for name in names if name not in known]:
            raise DemoError(
                f"{self.where}: there is no demonstration {unknown[0]!r}; there are "
                f"{', '.join(known):.2000}."
            )
        return tuple(known[name] for name in names)

    @functools.cached_property
    def _by_name(self) -> dict[str, Demo]:
        return dict(zip(self.names, self.demos, strict=True))

    def split(self, held_out: int | None = None) -> dict[str, list[str]]:
        """Names of demonstrations to "train" on, of the last ones, kept aside for "validation", and
        of each "failure". None keeps a quarter aside, rounded up."""
        good = [demo.name for demo in self.demos if demo.outcome != "failure"]
        held = math.ceil(len(good) / 4) if held_out is None else held_out
        bad = [demo.name for demo in self.demos if demo.outcome == "failure"]
        train = len(good) - held
        return {"train": good[:train], "validation": good[train:], "failure": bad}

    def save(self, folder: str | os.PathLike, *, progress: bool = True) -> None:
        """Writes the set, with a progress line on stderr; see `save_demo_set`."""
        with Progress(shown=progress) as shown:
            tell, done = shown.steps("writing", "videos"), itertools.count(1)
            save_demo_set(self, folder, progress=lambda total: tell(next(done), total))


def save_demo_set(
    demo_set: DemoSet,
    folder: str | os.PathLike,
    *,
    progress: Callable[[int], None] | None = None,
) -> None:
    """Writes a set to a new or empty folder, or in place of an older set once it is complete.

    Few videos are in memory at once. Errors are those of `write_demo_set`; `progress` is called
    after each video with the number of all.
    """

    def read() -> Iterator[Demo]:
        videos = parallel_map(lambda demo: demo.frames, demo_set)
        for demo, frames in zip(demo_set, videos, strict=True):
            yield replace(demo, video=frames)
            if progress is not None:
                progress(len(demo_set))

    about = demo_set.about | {"notes": demo_set.notes}
    write_demo_set(folder, read(), **about)


def load_demo_set(folder: str | os.PathLike) -> DemoSet:
    """Reads a demo set; a DemoError for what is missing, was changed, or breaks the schema."""
    folder = pathlib.Path(folder)
    header = read_header(folder)
    about = {name: header[name] for name in ABOUT}
    about |= {name: float(header[name]) for name in ("half_extent", "fps")}
    about |= {name: tuple(header[name]) for name in ("classes", "robots")}
    given = header["classes"], about["half_extent"]
    demos = tuple(read_demo(folder, entry, *given) for entry in header["demos"])
    return DemoSet(demos, **about, folder=folder)


def demo_batch(demo_set: DemoSet, names: Sequence[str] | None = None) -> DemoBatch:
    """Demonstrations as arrays, padded to the longest with their last frames; all without `names`.

    Objects are ordered by label, those of one label by their x in the first frame; a DemoError if
    they differ between demonstrations. One that a demonstration never shows is padding there.
    """
    names = demo_set.names if names is None else list(names)
    if not names:
        raise DemoError(f"{demo_set.where}: a batch needs at least 1 demonstration, got none.")
    tracks = [demo.tracks for demo in demo_set.select(names)]
    tracks = [track.of(np.lexsort((track.center[0, :, 0], track.label))) for track in tracks]
    for name, track in zip(names, tracks, strict=True):
        if not np.array_equal(track.label, tracks[0].label):
            objects = [", ".join(demo_set.classes[i] for i in t.label) for t in (tracks[0], track)]
            raise DemoError(
                f"{demo_set.where}: all demonstrations of a batch must hold the same objects, "
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


def select_objects(demo_set: DemoSet, objects: Sequence[str]) -> DemoSet:
    """The same demonstrations with only the named objects, trimmed to the end of their motion; a
    DemoError if one lacks an object.

    A task with fewer blocks than a video shows can so learn from it. Files stay as they are.
    """
    demos = []
    for demo in demo_set:
        own = demo_set.objects(demo)
        if missing := [name for name in objects if name not in own]:
            raise DemoError(
                f"{demo_set.where}: {demo.name!r} shows {', '.join(own)}, but the task also has "
                f"{missing[0]}."
            )
        keep = [i for i, name in enumerate(own) if name in objects]
        fewer = replace(demo, tracks=demo.tracks.of(keep))
        if len(keep) < len(own):
            kept = trim_static_tail(fewer.tracks, demo_set.classes, robots=demo_set.robots)
            cut = replace(fewer, trimmed=demo.trimmed + len(demo) - kept)
            fewer = cut.during(slice(kept))
        demos.append(fewer)
    return replace(demo_set, demos=tuple(demos))


def frame_batch(
    demo_set: DemoSet, names: Sequence[str], *, pixels: int, half_extent: float | None = None
) -> VideoBatch:
    """The frames of some demonstrations as small squares, padded as `demo_batch` pads their boxes.

    They show the world as far as `half_extent`, or the set's own. One video at a time is decoded; a
    DemoError if it is damaged, not square, or not as long as its boxes.
    """
    zoom = 1.0 if half_extent is None else half_extent / demo_set.half_extent
    videos = []
    for demo in demo_set.select(names):
        frames = demo.frames
        height, width = frames.shape[1:3]
        if height != width:
            raise DemoError(
                f"{demo_set.where}, {demo.name!r}: frames are {width} x {height}, but must be "
                "square."
            )
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
