"""Demonstrations of objects that are found by their colour, in videos or MAGICAL's recordings.

All videos have one frame rate, which is the set's, and boxes are taken as they were found.
"""

import functools
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from gril_jax.config import EnvConfig
from gril_jax.errors import DemoError
from gril_jax.threads import parallel_map

from .demo import Demo, trim_static_tail
from .demo_set import DemoSet
from .magical_pickles import FPS, HALF_EXTENT, list_magical, read_magical
from .schema import ROBOTS, outcomes
from .vision.detect import PALETTE_CLASSES, ColourDetector, Detector
from .vision.fills import FillDetector
from .vision.palette import SUITE
from .vision.video import read_fps, read_video

WORLD = "world units"  # that whoever imports videos has named by their half extent


def by_colour(
    task: str,
    half_extent: float,
    *,
    classes: Sequence[str] = PALETTE_CLASSES,
    objects: Sequence[str] | None = None,
) -> Detector:
    """The detector for a task's palette; `objects` are those that every video holds."""
    if task in SUITE:
        return FillDetector(half_extent)
    return ColourDetector(classes, half_extent, objects=objects)


def of_magical(
    folder: Path, task: str | None, progress: Callable[[int], None], source: str | None = None
) -> DemoSet:
    """The demonstrations of MAGICAL's public `*.pkl.gz` files, their objects found by colour.

    Frames of the allocentric view are kept, actions are not. A demonstration is a success where
    its score is 1. `task` is the one that the set is for, if not the one of the recordings' name.

    Raises:
      DemoError: no files, a damaged or foreign one, different tasks, or objects not found.
    """
    paths = list_magical(folder)
    recorded = read_magical(paths[0]).env_name
    name = task or re.sub("(?<!^)(?=[A-Z])", "_", recorded.split("-")[0]).lower()  # match_regions
    detector = by_colour(name, HALF_EXTENT)

    def seen(path: Path) -> Demo:
        demo = read_magical(path)
        if demo.env_name != recorded:
            raise DemoError(
                f"{path}: recorded in {demo.env_name!r}, but {paths[0].name} in {recorded!r}; "
                "a demo set holds one task."
            )
        return Demo(
            path.name.removesuffix(".pkl.gz"),
            lambda: read_magical(path).frames,  # a hundred megabytes, not kept
            detector.detect(demo.frames, name=str(path)),
            outcome="success" if demo.score >= 1 else "failure",
        )

    source = source or f"MAGICAL human demonstrations, {recorded}, allocentric view"
    return _trimmed(
        map(seen, paths), len(paths), detector, progress, task=name, fps=FPS, source=source,
        unit=f"world units of {name}",
    )  # fmt: skip


def of_videos(
    folder: Path,
    paths: Sequence[Path],
    detector: Detector | None,
    *,
    half_extent: float | None,
    task: str | None,
    outcome: str | Mapping[str, str],
    source: str | None,
    progress: Callable[[int], None],
) -> DemoSet:
    """The demonstrations of videos; without a detector, objects are found by the task's colours.

    Raises:
      DemoError: a damaged video, different frame rates, or objects not found.
    """
    name = EnvConfig.name if task is None else task
    if detector is None:
        if half_extent is None:
            raise DemoError(
                "half_extent is None, but boxes by colour need half the width of the world that a "
                "frame shows."
            )
        detector = by_colour(name, half_extent)
    fps = read_fps(paths[0])
    each = outcomes(outcome, [path.stem for path in paths])

    def seen(path: Path) -> Demo:
        if abs(read_fps(path) - fps) > 0.01:
            raise DemoError(
                f"{path}: has {read_fps(path):g} frames per second, but {paths[0].name} "
                f"has {fps:g}; a demo set holds one frame rate."
            )
        tracks = detector.detect(read_video(path), name=str(path))
        return Demo(path.stem, functools.partial(_pictures, path), tracks, outcome=each[path.stem])

    source = f"{len(paths)} videos of {folder.name}" if source is None else source
    return _trimmed(
        parallel_map(seen, paths), len(paths), detector, progress, task=name, fps=fps,
        source=source, unit=WORLD,
    )  # fmt: skip


def _pictures(path: Path) -> UInt8[np.ndarray, "T H W 3"]:
    """A video's frames, without the last row or column where that makes their number even, as a
    set's videos need."""
    frames = read_video(path)
    height, width = frames.shape[1:3]
    return frames[:, : height // 2 * 2, : width // 2 * 2]


def _trimmed(
    demos: Iterable[Demo],
    total: int,
    detector: Detector,
    progress: Callable[[int], None],
    **about: Any,
) -> DemoSet:
    """The set of these demonstrations without their static ends.

    Where a robot is all that can move, it is the one whose place counts, and no robot.
    """
    found: list[Demo] = []
    classes = tuple(detector.classes)
    for demo in demos:
        if not found:
            names = {classes[label] for label in demo.tracks.label}
            alone = all(name == "robot" or name.endswith("region") for name in names)
        kept = trim_static_tail(demo.tracks, classes, robots=() if alone else ROBOTS)
        found.append(replace(demo, trimmed=len(demo) - kept).during(slice(kept)))
        progress(total)
    return DemoSet(
        tuple(found), classes=classes, half_extent=float(detector.half_extent),
        robots=() if alone else None, **about,
    )  # fmt: skip
