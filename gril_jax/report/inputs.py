"""A run's folder and its demonstrations, read once; what is damaged is a RunError or DemoError."""

from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from gril_jax.config import RunConfig
from gril_jax.config.task import NO_TASK
from gril_jax.demos.demo import Demo
from gril_jax.demos.demo_set import DemoSet, load_demo_set, select_objects
from gril_jax.demos.schema import HEADER
from gril_jax.graphs import activity
from gril_jax.report.figures.filmstrip import Film
from gril_jax.runs.reading import read_config, require_same_demos, require_unchanged
from gril_jax.threads import parallel_map

from .data import Profiles, read_finished, read_profiles, read_rows, read_versions
from .html import save

_LATER = ("versions.json", "rollout.mp4", "rollouts.npz")  # what is read while the page is drawn
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


def read_inputs(folder: Path) -> Inputs:
    """Reads a run's folder, and its demonstrations if they still exist."""
    config = read_config(folder)
    require_unchanged(folder, *_LATER)  # before anything is drawn
    read_versions(folder)
    profiles = read_profiles(folder)
    source = Path(config.demos.path) if config.demos.path else folder / "demos"
    require_same_demos(folder, source / HEADER)
    demos = load_demo_set(source) if (source / HEADER).is_file() else None
    # Sets of one's own films have no objects but those that are wanted.
    if demos is not None and config.env.name != NO_TASK and not config.env.is_own:
        wanted = ("goal", "robot", *config.env.targets, *config.env.distractors)
        known = [o for o in wanted if all(o in demos.objects(demo) for demo in demos)]
        fewer = {*config.env.targets} <= {*known}  # a task without blocks to choose has them all
        demos = select_objects(demos, known) if fewer else demos
    rows, results = read_rows(folder), read_finished(folder) or {}
    return Inputs(folder, config, rows, results, profiles, demos, _to_show(profiles, demos))


def _to_show(profiles: Profiles | None, demos: DemoSet | None) -> str | None:
    """A demonstration that the encoder was not trained on, if there is one."""
    if profiles is None:
        return None if demos is None else demos.names[0]
    first = [profiles.split.index(s) for s in ("validation", "train") if s in profiles.split]
    return profiles.names[first[0] if first else 0]


def films_of(run: Inputs) -> list[Film]:
    """The shown demonstration, then others; one of them failed, if any did."""
    if run.demos is None:
        return []
    failed = run.demos.split()["failure"]
    order = sorted(run.demos.names, key=lambda name: (name != run.shown, name in failed))  # stable
    chosen = order[:_FILMS]
    if failed and not set(failed) & set(chosen):
        chosen[-1] = failed[0]
    picked = run.demos.select(chosen)
    most = max(map(len, picked))
    videos = parallel_map(lambda demo: demo.frames, picked)
    return [_film(run, demo, frames, most) for demo, frames in zip(picked, videos, strict=True)]


def _film(run: Inputs, demo: Demo, frames: np.ndarray, most: int) -> Film:
    """A demonstration with its activity bits; the longest that is shown has `most` frames."""
    # A bit depends on no later frame: all films as long as the longest are one program.
    edge = ((0, most - len(demo)), (0, 0), (0, 0))
    padded = [np.pad(x, edge, mode="edge") for x in (demo.tracks.center, demo.tracks.size)]
    bits = np.asarray(_bits(*padded, **run.config.pool.rule()))[: len(demo)]
    return Film(demo.name, frames, demo.tracks, bits)
