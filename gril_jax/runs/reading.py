"""Reads a run's folder: its configuration, its metrics and its results, each as the run wrote it.

JAX is not imported here.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gril_jax.config import RunConfig
from gril_jax.config.files import load
from gril_jax.errors import ConfigError, RunError
from gril_jax.safe_files import read_object, require_regular

from . import covered, times
from .checkpoints import manifest
from .metric_rows import Mark, read_rows
from .phases import Phases, changed_fields, read_phases, require_run


def marks_of(path: Path, phases: Phases) -> tuple[Sequence[Mark], Sequence[str]]:
    """The lines of metrics.jsonl that phases.json and each phase's newest checkpoint cover, and a
    sentence for each checkpoint whose mark cannot be read. Of a finished run the first has all."""
    found, damaged = [phases.metrics] if phases.metrics else [], list[str]()
    for folder in [] if phases.done else sorted((path / "checkpoints").glob("*")):
        for step in reversed(manifest.steps(folder)):
            try:
                mark = manifest.manifest(folder / f"{step:012d}").get("metrics")
            except manifest.DamagedError as error:  # the one before it is taken
                damaged.append(str(error))
                continue
            except RunError:  # removed at this moment, by the process that writes them
                continue
            found += [mark] if mark else []
            break
    return found, damaged


def read_config(path: Path) -> RunConfig:
    """Reads a run's configuration, which must be the one that the run began with."""
    file = _file(path, "config.yaml")
    try:
        config, text = load(str(file)), file.read_text(encoding="utf-8")
    except ConfigError as error:
        raise RunError(str(error)) from None
    if not text.strip():
        raise RunError(f"{file} is empty, but must hold the configuration of the run")
    began = read_phases(path).config
    if text != began:
        what = ", ".join(changed_fields(began, config)) or "its text is another than in phases.json"
        raise RunError(f"{file} has been changed since the run began: {what}")
    return config


def task_digest(path: Path) -> str | None:
    """The SHA-256 that a run has noted of the file of its task; None if it has noted none."""
    covered.require_unchanged(path, "versions.json")
    try:
        noted = read_object(path / "versions.json").get("task_sha256")
    except FileNotFoundError:
        return None
    return noted if isinstance(noted, str) else None


def _file(path: Path, name: str) -> Path:
    """A file of a run, which need not be there yet; a RunError if the folder is of no run."""
    require_run(path)
    return path / name


def read_metrics(path: Path, *, clocks: bool = False) -> list[dict[str, Any]]:
    """Reads a run's metrics so far, oldest first; with their `clocks` from times.jsonl, if wanted.

    An incomplete last line is left out.
    """
    file, phases = _file(path, "metrics.jsonl"), read_phases(path)
    require_regular(file)
    marks, damaged = marks_of(path, phases)  # before the file, which may be growing
    if damaged:
        raise RunError(damaged[0])
    try:
        rows = read_rows(file, marks, whole=phases.done)
    except FileNotFoundError:
        raise RunError(f"the run in {path} has no metrics yet: it lacks {file.name}") from None
    except OSError as error:
        raise RunError(f"{file} cannot be read ({error})") from None
    return times.with_clocks(rows, times.read_times(path)) if clocks else rows


def read_results(path: Path) -> dict[str, Any]:
    """The results of a finished run; a `RunError` for any other."""
    file = _file(path, "results.json")
    covered.require_unchanged(path, file.name)
    try:
        return read_object(file)
    except FileNotFoundError:
        raise RunError(f"the run in {path} has not finished: it lacks results.json") from None
