"""Reads and checks a run's folder for its report: what is missing is None.

    profiles.npz   the learned reward along each demonstration (B, T), where its stages end
    rollouts.npz   the reward in each evaluation episode (E, T), and which one was filmed

B is demonstrations, E episodes, T frames or steps. `gril_jax.runs.run_dir` has the other files. A
file that is damaged, is not as the run wrote it, or whose parts do not fit together is a
`RunError`.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from gril_jax.config.tables import ALGORITHMS
from gril_jax.demos.files import NotPlainError, read_plain
from gril_jax.errors import RunError
from gril_jax.runs.covered import require_unchanged
from gril_jax.runs.phases import read_phases
from gril_jax.runs.reading import read_metrics, read_results
from gril_jax.safe_files import read_object

SPLITS = ("train", "validation", "failure")
# Which field counts, by phase.
_STEP = {"pretrain": "step"} | dict.fromkeys(ALGORITHMS, "env_steps")
_LARGEST = 1e30  # a number beyond it is damage, and would overflow when drawn


class Profiles(NamedTuple):
    """The learned reward along demonstrations."""

    names: tuple[str, ...]
    split: tuple[str, ...]  # of `SPLITS`
    reward: Float[np.ndarray, "B T"]  # padded with the last value
    length: Int[np.ndarray, "B"]  # frames before padding
    transitions: Bool[np.ndarray, "B T"]  # frames at which a stage ends

    def traces(self, split: str) -> list[Float[np.ndarray, "_"]]:
        """The rewards of one split's demonstrations, without padding."""
        chosen = [i for i, name in enumerate(self.split) if name == split]
        return [self.reward[i, : self.length[i]] for i in chosen]


class Rollouts(NamedTuple):
    """Evaluation episodes of the trained policy."""

    reward: Float[np.ndarray, "E T"]  # of each step, so of frames 1 to T
    success: Bool[np.ndarray, "E"]
    shown: int  # the episode in rollout.mp4


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


def read_rollouts(folder: Path) -> Rollouts | None:
    """Reads rollouts.npz; None if there is none."""
    require_unchanged(folder, "rollouts.npz")
    path = folder / "rollouts.npz"
    arrays = _arrays(path, {"reward": "f", "success": "bf", "shown": "iu"})
    if arrays is None:
        return None
    reward, success, shown = arrays["reward"], arrays["success"], arrays["shown"]
    if reward.ndim != 2 or not reward.size:
        raise RunError(f"{path}: reward has shape {reward.shape}, but must be (E, T)")
    _require_shape(path, "success", success, reward.shape[:1])
    _require_shape(path, "shown", shown, ())
    if not 0 <= int(shown) < len(reward):
        raise RunError(f"{path}: shown is {int(shown)}, but there are {len(reward)} episodes")
    return Rollouts(reward, success > 0.5, int(shown))


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
