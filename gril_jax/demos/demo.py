"""One demonstration: its objects in every frame, and its video. T is frames, N objects."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, UInt8

Frames = UInt8[np.ndarray, "T H W 3"]

MARGIN = 5  # frames kept after the first in which all blocks have arrived
_MOVING = 0.01  # world units from its final place: an object nearer than this has arrived


class Tracks(NamedTuple):
    """The objects of one video, frame by frame."""

    center: Float32[np.ndarray, "T N 2"]  # centre of mass, in the set's unit
    size: Float32[np.ndarray, "T N 2"]  # width and height of the axis-aligned box, same unit
    label: Int32[np.ndarray, "N"]  # index into the class names
    seen: Bool[np.ndarray, "T N"]  # False where the last (or first) sighting stands in

    def during(self, frames: slice) -> "Tracks":
        """The same objects in some of the frames."""
        return Tracks(self.center[frames], self.size[frames], self.label, self.seen[frames])

    def of(self, objects: Sequence[int] | np.ndarray) -> "Tracks":
        """Only these objects, in this order."""
        center, size, seen = (x[:, objects] for x in (self.center, self.size, self.seen))
        return Tracks(center, size, self.label[objects], seen)


class Source(NamedTuple):
    """The frames of the video that was imported, of which a resampled one shows some."""

    frame: Int32[np.ndarray, "T"]  # counted from 0
    time: Float64[np.ndarray, "T"]  # seconds from its first frame

    def during(self, frames: slice) -> "Source":
        """The same in some of the frames."""
        return Source(self.frame[frames], self.time[frames])


@dataclass(frozen=True, eq=False)
class Demo:
    """One demonstration; `len` is its number of frames.

    Two are equal if all but their videos are.
    """

    name: str
    video: Frames | Callable[[], Frames]  # RGB, or a function that reads it: see `frames`
    tracks: Tracks  # of the same T frames
    trimmed: int = 0  # frames already cut from the static tail
    outcome: str = "unknown"  # or "success", "failure"
    # Frame at which each stage of the task was first finished, -1 never; None: not known.
    stages: Mapping[str, int] | None = None
    source: Source | None = None  # None: the frames are those of the original

    def __len__(self) -> int:
        return len(self.tracks.center)

    @property
    def frames(self) -> Frames:
        """The frames of the video, read anew each time unless they are in memory; a DemoError if
        they cannot be read."""
        return self.video() if callable(self.video) else self.video

    def during(self, span: slice) -> "Demo":
        """The same demonstration in some of its frames; stages keep the frames of the whole."""
        tracks = self.tracks.during(span)
        source = None if self.source is None else self.source.during(span)
        return replace(self, video=lambda: self.frames[span], tracks=tracks, source=source)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Demo):
            return NotImplemented
        fields = ("name", "trimmed", "outcome", "stages")
        mine, theirs = ([*one.tracks, *(one.source or (np.zeros(0),) * 2)] for one in (self, other))
        return all(getattr(self, name) == getattr(other, name) for name in fields) and all(
            np.array_equal(one, two) for one, two in zip(mine, theirs, strict=True)
        )

    __hash__ = None  # it holds arrays


def trim_static_tail(
    tracks: Tracks,
    classes: Sequence[str],
    *,
    robots: Sequence[str],
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
    return min(len(tracks.center), arrived + 1 + MARGIN)
