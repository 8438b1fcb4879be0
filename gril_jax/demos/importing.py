"""Converts foreign demonstrations to a demo set: detect, trim the static tail, save.

One demonstration is in memory at a time (a MAGICAL file unpacks to about 107 MB).
"""

import os
import pathlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8

from gril_jax.config import EnvConfig
from gril_jax.demos.demo_set import Demo, save_demo_set, trim_static_tail
from gril_jax.demos.vision.detect import PALETTE_CLASSES, ColourDetector, Detector, Tracks
from gril_jax.demos.vision.video import read_fps, read_video
from gril_jax.errors import DemoError
from gril_jax.threads import parallel_map

from .boxes_csv import BoxesFileDetector
from .magical_pickles import FPS, HALF_EXTENT, list_magical, read_magical

_VIDEOS = (".mp4", ".m4v", ".mov", ".mkv", ".webm", ".avi", ".gif")


class Imported(NamedTuple):
    """The outcome of importing one demonstration."""

    name: str
    frames: int  # kept
    trimmed: int  # cut from the static tail
    outcome: str
    seen: float  # share of (frame, object) pairs that were detected and not carried on


_Seen = tuple[str, np.ndarray, Tracks, str]  # a video's name, frames, tracks and outcome

AfterEach = Callable[[int, int, Imported], None]
"""Called after each demonstration with the number done, the total, and the last result."""


def import_magical(
    source_dir: str | os.PathLike, out_dir: str | os.PathLike, *, progress: AfterEach | None = None
) -> list[Imported]:
    """Converts a folder of MAGICAL's public `*.pkl.gz` files to a demo set.

    Frames of the allocentric view are kept, actions are not. A demonstration is a success where
    its score is 1. An older demo set of that name is replaced.

    Raises:
      DemoError: no files, a damaged or foreign one, different tasks, or objects not found.
    """
    paths = list_magical(source_dir)
    detector = ColourDetector(PALETTE_CLASSES, HALF_EXTENT)
    task = read_magical(paths[0]).env_name
    report: list[Imported] = []

    def looked_at() -> Iterator[_Seen]:
        for path in paths:
            demo = read_magical(path)
            if demo.env_name != task:
                raise DemoError(
                    f"{path}: recorded in {demo.env_name!r}, but {paths[0].name} in {task!r}; "
                    "a demo set holds one task."
                )
            outcome = "success" if demo.score >= 1 else "failure"
            tracks = detector.detect(demo.frames, name=str(path))
            yield path.name.removesuffix(".pkl.gz"), demo.frames, tracks, outcome

    save_demo_set(
        out_dir,
        _trimmed(looked_at(), PALETTE_CLASSES, len(paths), report, progress),
        task=_snake(task.split("-")[0]),
        classes=PALETTE_CLASSES,
        half_extent=HALF_EXTENT,
        fps=FPS,
        source=f"MAGICAL human demonstrations, {task}, allocentric view",
    )
    return report


def import_videos(
    source_dir: str | os.PathLike,
    out_dir: str | os.PathLike,
    half_extent: float,
    task: str = EnvConfig.name,
    boxes: bool = False,
    *,
    classes: Sequence[str] = PALETTE_CLASSES,
    objects: Sequence[str] | None = None,
    outcome: str | Mapping[str, str] = "unknown",
    source: str | None = None,
    progress: AfterEach | None = None,
) -> list[Imported]:
    """Converts a folder of videos to a demo set.

    Args:
      source_dir: folder of videos of one frame rate; sorted by name.
      out_dir: the demo set; replaced if it is one already.
      half_extent: half the width of the world that a frame shows, in world units.
      boxes: read `NAME.csv` beside each `NAME.mp4` (`gril_jax.demos.boxes_csv`) instead of
        detecting by colour.
      objects: the objects that every video holds; None takes what is found.
      outcome: "success", "failure" or "unknown": of all the videos, or of each by its stem.
      source: where the videos came from, in words; None names the folder.

    Raises:
      DemoError: no videos, a damaged one, different frame rates, or objects not found.
    """
    if not half_extent > 0:
        raise DemoError(f"half_extent: must be above 0 world units, not {half_extent}.")
    folder = pathlib.Path(source_dir)
    paths = sorted(p for p in folder.glob("*") if p.suffix.lower() in _VIDEOS)
    if not paths:
        raise DemoError(f"{folder}: the folder holds no video ({', '.join(_VIDEOS)}).")
    stems = [path.stem for path in paths]
    for path in paths:
        if stems.count(path.stem) > 1:
            raise DemoError(f"{path}: two videos are called {path.stem!r}; names must differ.")
    fps = read_fps(paths[0])
    report: list[Imported] = []
    colours: Detector = ColourDetector(classes, half_extent, objects=None if boxes else objects)

    def look(path: pathlib.Path) -> tuple[UInt8[np.ndarray, "T H W 3"], Tracks]:
        if abs(read_fps(path) - fps) > 0.01:
            raise DemoError(
                f"{path}: has {read_fps(path):g} frames per second, but {paths[0].name} "
                f"has {fps:g}; a demo set holds one frame rate."
            )
        frames, detector = read_video(path), colours
        if boxes:
            detector = BoxesFileDetector(path.with_suffix(".csv"), classes, half_extent)
        return frames, detector.detect(frames, name=str(path))

    def looked_at() -> Iterator[_Seen]:
        for path, seen in zip(paths, parallel_map(look, paths), strict=True):
            yield path.stem, *seen, outcome if isinstance(outcome, str) else outcome[path.stem]

    save_demo_set(
        out_dir,
        _trimmed(looked_at(), classes, len(paths), report, progress),
        task=task,
        classes=classes,
        half_extent=half_extent,
        fps=fps,
        source=f"{len(paths)} videos of {folder.name}" if source is None else source,
    )
    return report


def _trimmed(
    videos: Iterable[_Seen],
    classes: Sequence[str],
    total: int,
    report: list[Imported],
    progress: AfterEach | None,
) -> Iterator[Demo]:
    """The videos without their static tails, each reported once the next is asked for."""
    for name, frames, tracks, outcome in videos:
        kept = trim_static_tail(tracks, classes)
        short, cut = tracks.during(slice(kept)), len(frames) - kept
        report.append(Imported(name, kept, cut, outcome, float(short.seen.mean())))
        yield Demo(name, frames[:kept], short, cut, outcome)
        if progress is not None:
            progress(len(report), total, report[-1])


def _snake(name: str) -> str:
    """Converts a name to snake case: MatchRegions -> match_regions."""
    return "".join(f"_{c.lower()}" if c.isupper() else c for c in name).lstrip("_")
