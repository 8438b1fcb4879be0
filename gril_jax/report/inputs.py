"""Inputs of a report: a run's folder and its demonstrations, read once."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import UInt8

from gril_jax.config import RunConfig
from gril_jax.demos.demo_set import DemoSet, load_demo_set, select_objects
from gril_jax.demos.schema import HEADER
from gril_jax.demos.vision.video import read_video, write_video
from gril_jax.errors import RunError
from gril_jax.graphs import activity
from gril_jax.report.figures.filmstrip import Film
from gril_jax.runs.run_dir import read_config
from gril_jax.safe_files import writing
from gril_jax.threads import parallel_map

from .data import Profiles, read_finished, read_profiles, read_rows
from .html import save

__all__ = ["Inputs", "films_of", "read_inputs"]

_FILMS = 3  # demonstrations on the contact sheet
_bits = jax.jit(activity.trajectory, static_argnames=("window", "smoothing", "noise"))


class Inputs(NamedTuple):
    """All that was read of a run; the report's files go into the same folder."""

    folder: Path
    config: RunConfig
    rows: dict[str, list[dict[str, Any]]]  # metrics, by phase
    results: dict[str, Any]  # empty where the run has not finished
    profiles: Profiles | None
    demos: DemoSet | None  # only the task's objects; None where the set is gone
    shown: str | None  # the demonstration that is shown in detail

    def save(self, name: str, contents: bytes) -> bytes:
        """Writes a file of the report, complete or not at all; returns its contents."""
        return save(self.folder / name, contents)

    def save_video(self, name: str, frames: Iterator[np.ndarray], fps: float) -> bytes:
        """Writes a video of the report; returns the file's contents."""
        write_video(self.folder / name, frames, fps)
        with writing(self.folder):
            return (self.folder / name).read_bytes()


def read_inputs(folder: Path) -> Inputs:
    """Reads a run's folder, and its demonstrations if they still exist.

    Raises:
      RunError: it is no run's folder, or a file in it is damaged.
      DemoError: a file of the demonstrations is damaged.
    """
    config = read_config(folder)
    profiles = read_profiles(folder)
    source = Path(config.demos.path) if config.demos.path else folder / "demos"
    demos = load_demo_set(source) if (source / HEADER).is_file() else None
    if demos is not None:
        wanted = ("goal", "robot", *config.env.targets, *config.env.distractors)
        known = [o for o in wanted if all(o in entry.objects for entry in demos.entries)]
        demos = select_objects(demos, known) if known else demos
    return Inputs(
        folder,
        config,
        read_rows(folder),
        read_finished(folder) or {},
        profiles,
        demos,
        _to_show(profiles, demos),
    )


def _to_show(profiles: Profiles | None, demos: DemoSet | None) -> str | None:
    """A demonstration that the encoder was not trained on, if there is one."""
    if profiles is None:
        return None if demos is None else demos.entries[0].name
    first = [profiles.split.index(s) for s in ("validation", "train") if s in profiles.split]
    return profiles.names[first[0] if first else 0]


def films_of(run: Inputs) -> list[Film]:
    """The shown demonstration, then others; one of them failed, if any did.

    Raises:
      DemoError, RunError: a video is damaged, or shorter than the demonstration's header says.
    """
    if run.demos is None:
        return []
    names = [entry.name for entry in run.demos.entries]
    failed = [entry.name for entry in run.demos.entries if entry.outcome == "failure"]
    names.sort(key=lambda name: (name != run.shown, name in failed))  # stable
    chosen = names[:_FILMS]
    if failed and not set(failed) & set(chosen):
        chosen[-1] = failed[0]
    longest = max(entry.frames for entry in run.demos.entries if entry.name in chosen)
    files = {entry.name: run.demos.folder / entry.video for entry in run.demos.entries}
    videos = parallel_map(read_video, [files[name] for name in chosen])
    return [_film(run, name, frames, longest) for name, frames in zip(chosen, videos, strict=True)]


def _film(run: Inputs, name: str, frames: UInt8[np.ndarray, "T H W 3"], longest: int) -> Film:
    demos, pool = run.demos, run.config.pool
    index = [entry.name for entry in demos.entries].index(name)
    entry, tracks = demos.entries[index], demos.tracks[index]
    if len(frames) < entry.frames:
        raise RunError(
            f"{demos.folder / entry.video} has {len(frames)} frames, but {HEADER} says "
            f"{entry.frames}"
        )
    # A bit depends on no later frame: all films as long as the longest are one program.
    padded = [
        np.concatenate([x, np.repeat(x[-1:], longest - entry.frames, axis=0)])
        for x in (tracks.center, tracks.size)
    ]
    rule = {"window": pool.window, "smoothing": pool.smoothing, "noise": pool.noise}
    bits = np.asarray(_bits(*padded, tau=pool.tau, **rule))[: entry.frames]
    return Film(name, frames[: entry.frames], tracks, bits)
