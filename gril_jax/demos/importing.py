"""Converts foreign demonstrations to a demo set, one in memory at a time: detect, trim, save."""

import itertools
import os
import pathlib
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from gril_jax.config import EnvConfig
from gril_jax.demos.demo_set import ROBOTS, Demo, save_demo_set, trim_static_tail
from gril_jax.demos.vision.detect import PALETTE_CLASSES, ColourDetector, Detector, Tracks
from gril_jax.demos.vision.fills import FillDetector
from gril_jax.demos.vision.palette import SUITE, SUITE_CLASSES
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


WORLD = "world units"  # that whoever imports films has named by their half extent

_Seen = tuple[str, np.ndarray, Tracks, str]  # a video's name, frames, tracks and outcome

AfterEach = Callable[[int, int, Imported], None]
"""Called after each demonstration with the number done, the total, and the last result."""


def import_magical(
    source_dir: str | os.PathLike,
    out_dir: str | os.PathLike,
    *,
    task: str | None = None,
    progress: AfterEach | None = None,
) -> list[Imported]:
    """Converts a folder of MAGICAL's public `*.pkl.gz` files to a demo set.

    Frames of the allocentric view are kept, actions are not. A demonstration is a success where
    its score is 1. An older demo set of that name is replaced. `task` is the one that the set is
    for, if not the one of the recordings' name.

    Raises:
      DemoError: no files, a damaged or foreign one, different tasks, or objects not found.
    """
    paths = list_magical(source_dir)
    recorded = read_magical(paths[0]).env_name
    name = task or re.sub("(?<!^)(?=[A-Z])", "_", recorded.split("-")[0]).lower()  # match_regions
    detector, classes = _by_colour(name, PALETTE_CLASSES, HALF_EXTENT)

    def seen(path: pathlib.Path) -> _Seen:
        demo = read_magical(path)
        if demo.env_name != recorded:
            raise DemoError(
                f"{path}: recorded in {demo.env_name!r}, but {paths[0].name} in {recorded!r}; "
                "a demo set holds one task."
            )
        tracks = detector.detect(demo.frames, name=str(path))
        outcome = "success" if demo.score >= 1 else "failure"
        return path.name.removesuffix(".pkl.gz"), demo.frames, tracks, outcome

    return _save(
        out_dir,
        map(seen, paths),
        len(paths),
        progress,
        task=name,
        classes=classes,
        half_extent=HALF_EXTENT,
        fps=FPS,
        source=f"MAGICAL human demonstrations, {recorded}, allocentric view",
        unit=f"world units of {name}",
    )


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
    unit: str = WORLD,
    progress: AfterEach | None = None,
) -> list[Imported]:
    """Converts a folder of videos of one frame rate to a demo set, sorted by name.

    Args:
      out_dir: the demo set; replaced if it is one already.
      half_extent: half the width of the world that a frame shows, in world units.
      boxes: read `NAME.csv` beside each `NAME.mp4` (`gril_jax.demos.boxes_csv`) instead of
        detecting by colour.
      objects: the objects that every video holds; None takes what is found.
      outcome: "success", "failure" or "unknown": of all the videos, or of each by its stem.
      source: where the videos came from, in words; None names the folder.
      unit: of lengths, in words.

    Raises:
      DemoError: no videos, a damaged one, different frame rates, or objects not found.
    """
    if not half_extent > 0:
        raise DemoError(f"half_extent: must be above 0 world units, not {half_extent}.")
    folder = pathlib.Path(source_dir)
    paths = videos_in(folder, out_dir)
    fps = read_fps(paths[0])
    colours, classes = _by_colour(task, classes, half_extent, None if boxes else objects)

    def seen(path: pathlib.Path) -> _Seen:
        if abs(read_fps(path) - fps) > 0.01:
            raise DemoError(
                f"{path}: has {read_fps(path):g} frames per second, but {paths[0].name} "
                f"has {fps:g}; a demo set holds one frame rate."
            )
        frames, detector = read_video(path), colours
        if boxes:
            detector = BoxesFileDetector(path.with_suffix(".csv"), classes, half_extent)
        kind = outcome if isinstance(outcome, str) else outcome[path.stem]
        return path.stem, frames, detector.detect(frames, name=str(path)), kind

    return _save(
        out_dir,
        parallel_map(seen, paths),
        len(paths),
        progress,
        task=task,
        classes=classes,
        half_extent=half_extent,
        fps=fps,
        source=f"{len(paths)} videos of {folder.name}" if source is None else source,
        unit=unit,
    )


def _by_colour(
    task: str, classes: Sequence[str], half_extent: float, objects: Sequence[str] | None = None
) -> tuple[Detector, Sequence[str]]:
    """The detector for a task's palette, and the classes that it finds."""
    if task in SUITE:
        return FillDetector(half_extent), SUITE_CLASSES
    return ColourDetector(classes, half_extent, objects=objects), classes


def videos_in(
    folder: pathlib.Path, out_dir: str | os.PathLike, *, files: Iterable[pathlib.Path] | None = None
) -> list[pathlib.Path]:
    """The videos of a folder, sorted by name; a DemoError if there is none, if two have one name,
    or if the demo set would go into the folder itself."""
    files = folder.glob("*") if files is None else files
    paths = sorted(p for p in files if p.suffix.lower() in _VIDEOS)
    if not paths:
        raise DemoError(f"{folder}: the folder holds no video ({', '.join(_VIDEOS)}).")
    if os.path.realpath(folder) == os.path.realpath(out_dir):
        raise DemoError(f"{folder}: this folder is read, so the demo set must go to another one.")
    stems = [path.stem for path in paths]
    for path in paths:
        if any("\ud800" <= letter <= "\udfff" for letter in path.name):
            shown = str(path).encode(errors="backslashreplace").decode()
            raise DemoError(f"{shown}: the file's name is not text in UTF-8; rename it.")
    for path in paths:
        if stems.count(path.stem) > 1:
            raise DemoError(f"{path}: two videos are called {path.stem!r}; names must differ.")
    return paths


def _save(
    out_dir: str | os.PathLike,
    videos: Iterable[_Seen],
    total: int,
    progress: AfterEach | None,
    **header: Any,
) -> list[Imported]:
    """Saves videos without their static tails, each reported once the next is asked for.

    Where a robot is all that can move, it is the one whose place counts, and no robot.
    """
    report: list[Imported] = []
    first, videos = itertools.tee(videos)
    labels = next(first)[2].label
    del first  # or it would keep all videos
    found = {header["classes"][label] for label in labels}
    alone = all(name == "robot" or name.endswith("region") for name in found)
    if alone:
        header["robots"] = ()

    def demos() -> Iterator[Demo]:
        for name, frames, tracks, outcome in videos:
            kept = trim_static_tail(tracks, header["classes"], robots=() if alone else ROBOTS)
            short, cut = tracks.during(slice(kept)), len(frames) - kept
            report.append(Imported(name, kept, cut, outcome, float(short.seen.mean())))
            yield Demo(name, frames[:kept], short, cut, outcome)
            if progress is not None:
                progress(len(report), total, report[-1])

    save_demo_set(out_dir, demos(), **header)
    return report
