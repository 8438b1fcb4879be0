"""Reads and checks a run's folder and its demonstrations for its report: what is missing is None.

    profiles.npz   the learned reward along each demonstration (B, T), where its stages end
    rollouts.npz   the reward in each evaluation episode (E, T), and which one was recorded

B is demonstrations, E episodes, T frames or steps. `gril_jax.runs.run_dir` has the other files. A
file that is damaged, is not as the run wrote it, or whose parts do not fit together is a
`RunError`, or a `DemoError`.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from gril_jax.config import RunConfig
from gril_jax.config.tables import ALGORITHMS
from gril_jax.config.task import NO_TASK
from gril_jax.demos.demo import Demo
from gril_jax.demos.demo_set import DemoSet, load_demo_set, select_objects
from gril_jax.demos.files import NotPlainError, read_plain
from gril_jax.demos.schema import HEADER
from gril_jax.errors import RunError
from gril_jax.graphs import activity
from gril_jax.runs.json_lines import without_digest
from gril_jax.runs.reading import (
    read_config,
    read_metrics,
    read_phases,
    read_results,
    require_same_demos,
    require_unchanged,
)
from gril_jax.safe_files import read_object, require_regular
from gril_jax.threads import parallel_map

from .filmstrip import Film

SPLITS = ("train", "validation", "failure")
# Which field counts, by phase.
_STEP = {"pretrain": "step"} | dict.fromkeys(ALGORITHMS, "env_steps")
_LATER = ("versions.json", "rollout.mp4", "rollouts.npz")  # what is read while the page is drawn
_FILMS = 3  # demonstrations on the contact sheet
_bits = jax.jit(activity.trajectory, static_argnames=("window", "smoothing", "noise"))
_LARGEST = 1e30  # a number beyond it is damage, and would overflow when drawn


class Profiles(NamedTuple):
    """The learned reward along demonstrations."""

    names: tuple[str, ...]
    split: tuple[str, ...]  # of `SPLITS`
    reward: Float[np.ndarray, "B T"]  # padded with the last value
    length: Int[np.ndarray, "B"]  # frames before padding
    transitions: Bool[np.ndarray, "B T"]  # frames at which a stage ends


def read_profiles(folder: Path) -> Profiles | None:
    """Reads profiles.npz; None if there is none."""
    require_unchanged(folder, "profiles.npz")
    path = folder / "profiles.npz"
    fields = {"names": "U", "split": "U", "reward": "f", "length": "iu", "transitions": "b"}
    arrays = _arrays(path, fields)
    if arrays is None:
        return None
    names, split, reward, length, transitions = (arrays[field] for field in fields)
    count, frames = reward.shape if reward.ndim == 2 else (0, 0)
    if not count or not frames:
        raise RunError(f"{path}: reward has shape {reward.shape}, but must be (B, T)")
    for field in ("names", "split", "length"):
        _require_shape(path, field, arrays[field], (count,))
    _require_shape(path, "transitions", transitions, (count, frames))
    if ((length < 1) | (length > frames)).any():
        raise RunError(f"{path}: length must lie in 1 to {frames}, the frames of reward")
    for word in split.tolist():
        if word not in SPLITS:
            raise RunError(f"{path}: split holds {word!r:.40}, but must be {', '.join(SPLITS)}")
    return Profiles(tuple(names.tolist()), tuple(split.tolist()), reward, length, transitions)


class Outcome(NamedTuple):
    """The evaluation episodes that were recorded: the worst, the median and the best by return."""

    episodes: int  # of which these three are
    success: tuple[bool, ...]


def read_outcome(folder: Path) -> Outcome | None:
    """The outcome of the episodes of rollouts.npz that were recorded; None without the file."""
    require_unchanged(folder, "rollouts.npz")
    path = folder / "rollouts.npz"
    arrays = _arrays(path, {"reward": "f", "success": "bf", "shown": "iu"})
    if arrays is None:
        return None
    reward, success, shown = arrays["reward"], arrays["success"], arrays["shown"]
    if reward.ndim != 2 or not reward.size:
        raise RunError(f"{path}: reward has shape {reward.shape}, but must be (E, T)")
    _require_shape(path, "success", success, reward.shape[:1])
    _require_shape(path, "shown", shown, (3,))
    if not ((shown >= 0) & (shown < len(reward))).all():
        raise RunError(f"{path}: shown is {shown.tolist()}, but there are {len(reward)} episodes")
    return Outcome(len(reward), tuple(bool(one > 0.5) for one in success[shown]))


def _arrays(path: Path, kinds: Mapping[str, str]) -> dict[str, np.ndarray] | None:
    """The named arrays of a file; `kinds` are letters of `numpy.dtype.kind`."""
    if not path.exists():
        return None
    try:
        arrays = read_plain(path, kinds)
    except NotPlainError as error:
        raise RunError(f"{path}: {error}") from error
    for field, kind in kinds.items():
        if field not in arrays:
            raise RunError(f"{path}: the array {field!r} is missing")
        if arrays[field].dtype.kind not in kind:
            raise RunError(f"{path}: {field} must not be of type {arrays[field].dtype}")
        if kind == "U":
            try:  # an array may hold what is no letter, or half of one
                "".join(arrays[field].ravel().tolist()).encode()
            except (ValueError, SystemError):  # the latter from NumPy
                raise RunError(f"{path}: {field} must be text") from None
    return arrays


def _require_shape(path: Path, field: str, array: np.ndarray, shape: tuple) -> None:
    if array.shape != shape:
        raise RunError(f"{path}: {field} has shape {array.shape}, but must be {shape}")


def read_rows(folder: Path) -> dict[str, list[dict[str, Any]]]:
    """Rows of metrics.jsonl by phase, "pretrain" and the algorithm; empty before the first."""
    rows: dict[str, list[dict[str, Any]]] = {phase: [] for phase in _STEP}
    metrics = folder / "metrics.jsonl"
    if not metrics.exists() and read_phases(folder).metrics is None:
        return rows
    for line, row in enumerate(read_metrics(folder), 1):
        where = f"{metrics}: line {line}"
        phase = row.get("phase")
        if not isinstance(phase, str) or phase not in _STEP:
            continue
        values = {k: number(row, k, where) for k in row if k not in ("phase", "seed")}
        if values.get(_STEP[phase]) is None:
            raise RunError(f"{where}: the field {_STEP[phase]!r} is missing")
        rows[phase].append(values)
    return rows


def read_finished(folder: Path) -> dict[str, Any] | None:
    """Reads results.json; None if the run has not finished."""
    require_unchanged(folder, "results.json")
    return read_results(folder) if (folder / "results.json").exists() else None


def read_versions(folder: Path) -> dict[str, Any]:
    """Reads versions.json; empty if there is none."""
    require_unchanged(folder, "versions.json")
    path = folder / "versions.json"
    versions = read_object(path) if path.exists() else {}
    if not isinstance(versions.get("packages", {}), dict):
        raise RunError(f"{path} must be an object with fields, and packages another")
    return versions


def number(holder: Mapping[str, Any], field: str, where: str) -> float | None:
    """A field that is a number; None if it is missing, null or not finite."""
    value = holder.get(field)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise RunError(f"{where}: {field} must be a number, not {value!r:.40}")
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if abs(value) > _LARGEST:
        raise RunError(f"{where}: {field} is beyond all bounds")
    return float(value)


class Inputs(NamedTuple):
    """All that was read of a run; the report's files go into the same folder."""

    folder: Path
    config: RunConfig
    rows: dict[str, list[dict[str, Any]]]  # metrics, by phase
    results: dict[str, Any]  # empty where the run has not finished
    profiles: Profiles | None
    demos: DemoSet | None  # only the task's objects; None where the set is gone
    shown: str | None  # the demonstration that is shown in detail


def read_inputs(folder: Path, demos_at: Path | None = None) -> Inputs:
    """Reads a run's folder and its demonstrations, if they still exist, at `demos_at` if given."""
    config = read_config(folder, demos=demos_at)
    require_unchanged(folder, *_LATER)  # before anything is drawn
    read_versions(folder)
    profiles = read_profiles(folder)
    source = Path(config.demos.path) if config.demos.path else folder / "demos"
    require_same_demos(folder, source / HEADER)
    demos = load_demo_set(source) if (source / HEADER).is_file() else None
    # Sets of one's own videos have no objects but those that are wanted.
    if demos is not None and config.env.name != NO_TASK and not config.env.is_own:
        wanted = ("goal", "robot", *config.env.targets, *config.env.distractors)
        known = [o for o in wanted if all(o in demos.objects(demo) for demo in demos)]
        fewer = {*config.env.targets} <= {*known}  # a task without blocks to choose has them all
        demos = select_objects(demos, known) if fewer else demos
    rows, results = read_rows(folder), read_finished(folder) or {}
    if results and (audited := _later_audit(folder, results)):
        results = results | {"audit": audited}
    return Inputs(folder, config, rows, results, profiles, demos, _to_show(profiles, demos))


def _later_audit(folder: Path, results: Mapping[str, Any]) -> dict[str, Any] | None:
    """The contents of audit/audit.json, which `gril audit` wrote; None without one of this run's
    reward."""
    file = folder / "audit" / "audit.json"
    require_regular(file)
    try:
        found = without_digest(file.read_text(encoding="utf-8").removesuffix("\n"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError):
        found = None
    if found is None:
        raise RunError(f"{file} has been changed since gril audit wrote it")
    settings = found.get("settings")
    digest = settings.get("reward_sha256") if isinstance(settings, dict) else None
    return found if digest == results.get("reward_sha256") else None


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
    # A bit depends on no later frame: all videos as long as the longest are one program.
    edge = ((0, most - len(demo)), (0, 0), (0, 0))
    padded = [np.pad(x, edge, mode="edge") for x in (demo.tracks.center, demo.tracks.size)]
    bits = np.asarray(_bits(*padded, **run.config.pool.rule()))[: len(demo)]
    return Film(demo.name, frames, demo.tracks, bits)
