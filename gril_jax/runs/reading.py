"""Reads a run's folder: what a command reads is what the run wrote. JAX is not imported here.

phases.json, which has a digest of itself, holds the run's original configuration, its finished
phases, and the SHA-256 of the files of each phase from the time at which it has finished; it says
how far metrics.jsonl had come (see `gril_jax.runs.json_lines`):

{"experiment": "train", "config": "env:\\n ...", "finished": {"demos": {...}},
 "files": {"demos": {"demos/demos.json": "..."}}, "metrics": {"lines": 9, ...}, "sha256": "..."}

A command checks the files that it reads, and no others. Not covered: what a phase has written that
is still going on, but for its checkpoints; what is drawn from other files, such as report.html; and
times.jsonl.
"""

import dataclasses
import platform
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

import yaml

from gril_jax.config import RunConfig
from gril_jax.config.files import load, to_yaml
from gril_jax.errors import ConfigError, RunError
from gril_jax.safe_files import digest, read_object, require_regular, write_whole, writing

from . import checkpoints, places
from .json_lines import Mark, plain, read_rows, with_clocks, with_digest, without_digest

# What the numbers of a run can depend on; `gril doctor` shows the same list.
PACKAGES = (
    "gril-jax", "jax", "jaxlib", "flax", "optax", "jraph", "mujoco", "mujoco-mjx", "brax",
    "orbax-checkpoint", "warp-lang", "numpy", "scipy", "opencv-python-headless", "av",
)  # fmt: skip
_PHASES = "phases.json"
_INSTEAD = {"sweep": "its page is report.html, its table study.md"}


@dataclass(frozen=True)
class Phases:
    """The contents of phases.json."""

    experiment: str | None  # the experiment that can go on with the run, None if it cannot
    config: str  # YAML, as the run began
    finished: dict[str, dict[str, Any]] = field(default_factory=dict)  # phase to its results
    files: dict[str, dict[str, str]] = field(default_factory=dict)  # phase to digests
    metrics: dict[str, Any] | None = None  # how far metrics.jsonl is covered, as its `mark` says

    @property
    def done(self) -> bool:
        """True if the run has come to its results."""
        return "finished" in self.files


def write_phases(folder: Path, phases: Phases) -> None:
    """Replaces the file atomically; results are numbers, strings and lists of them."""
    with writing(folder):
        write_whole(folder / _PHASES, with_digest(plain(dataclasses.asdict(phases))) + "\n")


def read_phases(folder: Path) -> Phases:
    """The phases that `write_phases` wrote; a `RunError` if the file is missing or has changed."""
    file = folder / _PHASES
    require_regular(file)
    try:
        content = without_digest(file.read_text(encoding="utf-8").removesuffix("\n"))
        return Phases(**(content or {}))
    except FileNotFoundError:
        require_run(folder)
        raise RunError(f"{file} is missing, but the run had written it") from None
    except (OSError, ValueError, TypeError):
        raise RunError(f"{file} has been changed since the run wrote it") from None


def require_run(path: Path) -> None:
    """Raises a RunError if a folder is of no run."""
    if not path.is_dir():
        fault = "is a file" if path.exists() else "does not exist"
        raise RunError(f"{path} {fault}, but must be the folder of a run")
    if not (path / "config.yaml").is_file():
        raise RunError(f"{path} is not the folder of a run, because it has no config.yaml")


def require_single(folder: Path) -> None:
    """Raises a RunError that says where its results lie if a run has not one reward and policy."""
    experiment = read_phases(folder).experiment
    if experiment not in (None, "train", "pretrain"):
        instead = _INSTEAD.get(experiment, "its results lie there in files of their own")
        raise RunError(f"{folder} holds a run of gril {experiment}, not of one policy: {instead}")


def require_unchanged(folder: Path, *names: str) -> None:
    """Raises a RunError that names the first file which is not as the run wrote it, of those with
    these names, or below a folder whose name ends with a slash; what is not noted passes."""
    for files in read_phases(folder).files.values():
        for name, value in files.items():
            if name not in names and f"{name.partition('/')[0]}/" not in names:
                continue
            file = folder / name
            try:
                same = digest(file) == value
            except FileNotFoundError:
                raise RunError(f"{file} is missing, but the run had written it") from None
            except OSError as error:
                raise RunError(f"{file} cannot be read ({error.strerror})") from None
            if not same:
                raise RunError(f"{file} has been changed since the run wrote it")


def require_same_demos(folder: Path, header: Path) -> None:
    """Raises a RunError if a run began with another demonstration set than that of this header.

    A set outside of the run's folder may be gone.
    """
    require_unchanged(folder, "demos/demos.json")
    begun = read_phases(folder).finished.get("demos", {})
    if "sha256" in begun and header.is_file() and digest(header) != begun["sha256"]:
        raise RunError(
            f"the demonstration set {header.parent} has been changed since the run in {folder} "
            f"began, as its {header.name} shows"
        )


def marks_of(path: Path, phases: Phases) -> tuple[Sequence[Mark], Sequence[str]]:
    """The lines of metrics.jsonl that phases.json and each phase's newest checkpoint cover, and a
    sentence for each checkpoint whose mark cannot be read. Of a finished run the first has all."""
    found, damaged = [phases.metrics] if phases.metrics else [], list[str]()
    for folder in [] if phases.done else sorted((path / "checkpoints").glob("*")):
        for step in reversed(checkpoints.steps(folder)):
            try:
                mark = checkpoints.manifest(folder / f"{step:012d}").get("metrics")
            except checkpoints.DamagedError as error:  # the one before it is taken
                damaged.append(str(error))
                continue
            except RunError:  # removed just now, by the process that writes them
                continue
            found += [mark] if mark else []
            break
    return found, damaged


def read_config(path: Path, *, demos: Path | None = None) -> RunConfig:
    """Reads a run's configuration, which must be the one that the run began with.

    Its demonstration set is at `demos`, or where `places.with_demos` finds it.
    """
    require_run(path)
    file = path / "config.yaml"
    try:
        config, text = load(str(file)), file.read_text(encoding="utf-8")
    except ConfigError as error:
        raise RunError(f"{error}{_of_other_version(path)}") from None
    if not text.strip():
        raise RunError(f"{file} is empty, but must hold the configuration of the run")
    phases = read_phases(path)
    began = phases.config
    if text != began:
        what = ", ".join(changed_fields(began, config)) or "its text is another than in phases.json"
        raise RunError(f"{file} has been changed since the run began: {what}")
    if demos is not None:
        if config.demos.path is None:
            raise RunError(f"{path} holds its own demonstrations, so it has no use for --demos")
        return places.at(config, demos)
    return places.with_demos(config, path, phases.finished.get("demos", {}).get("sha256"))


def _of_other_version(path: Path) -> str:
    """Tells the version that made a run, if it is another than this one; empty otherwise."""
    try:
        made = read_object(path / "versions.json")["packages"]["gril-jax"]
    except (RunError, OSError, LookupError, TypeError):
        return ""
    ours = package_versions()["gril-jax"]
    return "" if made == ours else f": gril-jax {made} made the run, and this is {ours}"


def changed_fields(began: str | RunConfig, now: RunConfig) -> list[str]:
    """The changed fields of a configuration, such as `run.seed (0, not 1)`."""
    before = yaml.safe_load(began if isinstance(began, str) else to_yaml(began))
    after = yaml.safe_load(to_yaml(now))
    return [
        f"{section}.{name} ({after[section].get(name)!r}, not {value!r})"
        for section, fields in before.items()
        for name, value in fields.items()
        if after.get(section, {}).get(name) != value
    ]


def read_metrics(path: Path, *, clocks: bool = False) -> list[dict[str, Any]]:
    """Reads a run's metrics so far, oldest first; with their `clocks` from times.jsonl, if wanted.

    An incomplete last line is left out.
    """
    require_run(path)
    file, phases = path / "metrics.jsonl", read_phases(path)
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
    return with_clocks(rows, path) if clocks else rows


def read_results(path: Path) -> dict[str, Any]:
    """The results of a finished run; a `RunError` for any other."""
    require_run(path)
    require_unchanged(path, "results.json")
    try:
        return read_object(path / "results.json")
    except FileNotFoundError:
        raise RunError(f"the run in {path} has not finished: it lacks results.json") from None


def task_digest(path: Path) -> str | None:
    """The SHA-256 that a run has noted of the file of its task; None if it has noted none."""
    require_unchanged(path, "versions.json")
    try:
        noted = read_object(path / "versions.json").get("task_sha256")
    except FileNotFoundError:
        return None
    return noted if isinstance(noted, str) else None


def versions(device: str, command: Sequence[str] | None) -> dict[str, Any]:
    """What a run is made with, for its versions.json; the command is `sys.argv` where None."""
    return {
        "packages": package_versions(),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "device": device,
        "command": shlex.join(sys.argv if command is None else command),
    }


def package_versions() -> Mapping[str, str]:
    """The installed version of each package in `PACKAGES`, or "missing"."""
    found = {}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "missing"
    return found
