"""One run's folder: its configuration, versions, metrics and results, and the lock on it.

    config.yaml      the resolved configuration; `gril train FOLDER/config.yaml` runs it again
    phases.json      see `gril_jax.runs.phases`
    versions.json    package versions, Python, platform, device, command
    metrics.jsonl    see `gril_jax.runs.metric_rows`
    results.json     written when the run has finished
    checkpoints/     one folder a phase, see `gril_jax.runs.checkpoints.checkpoint`
    lock             see `take_lock` of `gril_jax.safe_files`

JAX is not imported here. Whatever is wrong with a run's folder, from a damaged file to a full disk,
is a `RunError`.
"""

import dataclasses
import itertools
import json
import platform
import shlex
import sys
import time
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any, TextIO

from gril_jax.config import RunConfig
from gril_jax.config.files import load, to_yaml
from gril_jax.errors import ConfigError, RunError
from gril_jax.safe_files import read_object, take_lock, write_whole, writing

from .metric_rows import MetricRows, plain, read_rows
from .phases import Phases, changed_fields, read_phases, write_phases
from .sinks import open_sink

# What the numbers of a run can depend on; `gril doctor` shows the same list.
PACKAGES = (
    "gril-jax", "jax", "jaxlib", "flax", "optax", "jraph", "mujoco", "mujoco-mjx", "brax",
    "orbax-checkpoint", "numpy", "scipy", "opencv-python-headless", "av",
)  # fmt: skip


class RunDir:
    """A run's folder, open for writing; made by `create` or `resume`, closed by `with`."""

    def __init__(self, path: Path, lock: TextIO, phases: Phases, config: RunConfig):
        self.path, self.checkpoints = path, path / "checkpoints"
        self.experiment = phases.experiment  # the one that can resume the run
        self._lock, self._phases = lock, phases
        self._sinks: list[Any] = []
        self.rows = MetricRows(path / "metrics.jsonl")
        try:
            rows = read_rows(self.rows.file)
            self._count = len(rows)
            for name in config.run.sinks:
                self._sinks.append(open_sink(name, path, dataclasses.asdict(config)))
                self._sinks[-1].begin(rows)
        except BaseException:
            self.close()
            raise

    def log(self, **metrics: Any) -> None:
        """Appends one line of metrics; arrays become lists, non-finite numbers become null."""
        row = plain(metrics)
        self.rows.append(row)
        for sink in self._sinks:
            sink.log(self._count, row)
        self._count += 1

    def cut_metrics(self, phase: str, count: int) -> list[dict[str, Any]]:
        """Keeps and returns the first `count` rows of a phase, and other rows before them."""
        rows = self.rows.keep(phase, count)
        if len(rows) != self._count:
            for sink in self._sinks:
                sink.begin(rows)
        self._count = len(rows)
        return rows

    def finished_phase(self, name: str) -> dict[str, Any] | None:
        """The results of a phase, or None while it has not finished."""
        return self._phases.finished.get(name)

    def finish_phase(self, name: str, results: Mapping[str, Any]) -> None:
        """Records that a phase has finished, so that a resumed run does not repeat it."""
        finished = self._phases.finished | {name: dict(results)}
        self._phases = dataclasses.replace(self._phases, finished=finished)
        write_phases(self.path, self._phases)

    def finish(self, results: Mapping[str, Any]) -> None:
        """Writes results.json, which marks the run as finished."""
        with writing(self.path):
            write_whole(self.path / "results.json", json.dumps(plain(results), indent=2) + "\n")

    def close(self) -> None:
        """Releases the lock; closing twice is harmless."""
        while self._sinks:
            self._sinks.pop().close()
        self.rows.close()
        self._lock.close()

    def __enter__(self) -> "RunDir":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def default_path(seed: int) -> Path:
    """A path under `runs/`, named after the time and the seed, that does not exist yet."""
    stem = f"{time.strftime('%Y%m%d-%H%M%S')}-seed{seed}"
    paths = (Path("runs") / f"{stem}{f'-{n}' if n > 1 else ''}" for n in itertools.count(1))
    return next(path for path in paths if not path.exists())


def create(
    path: Path,
    config: RunConfig,
    *,
    device: str,
    command: Sequence[str] | None = None,
    experiment: str | None = None,
    begun: Mapping[str, Mapping[str, Any]] | None = None,
) -> RunDir:
    """Creates a run's folder, which must not exist, and opens it for writing.

    Args:
      device: what the run computes on, in words.
      command: how the process was started; `sys.argv` where None.
      experiment: what can go on with the run if it is cut off; None if nothing can.
      begun: phases that have finished before the run began, with what they came to.
    """
    require_new(path)
    versions = {
        "packages": package_versions(),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "device": device,
        "command": shlex.join(sys.argv if command is None else command),
        "started": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
    }
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            path.mkdir()  # exclusive, whatever happened since it was looked at
        except FileExistsError:
            require_new(path)
        lock = take_lock(path)
        write_whole(path / "versions.json", json.dumps(versions, indent=2) + "\n")
        finished = {name: dict(results) for name, results in (begun or {}).items()}
        phases = Phases(experiment, to_yaml(config), finished)
        write_phases(path, phases)
        write_whole(path / "config.yaml", phases.config)  # last: it makes the folder a run
    return RunDir(path, lock, phases, config)


def resume(path: Path) -> RunDir:
    """Opens an existing run's folder for writing; its configuration must not have been changed."""
    config, phases = _read_unchanged(path)
    with writing(path):
        lock = take_lock(path)
    return RunDir(path, lock, phases, config)


def require_resumable(path: Path, experiment: str) -> RunConfig:
    """The configuration of a run that an experiment can resume; a `RunError` if it is no run, has
    finished, is of another experiment, was changed, or is being written."""
    config, phases = _read_unchanged(path)
    if phases.experiment != experiment:
        made = f"by gril {phases.experiment}" if phases.experiment else "otherwise"
        raise RunError(f"{path} was made {made}, so gril {experiment} cannot go on with it")
    if (path / "results.json").exists():
        raise RunError(
            f"the run in {path} has finished, so there is nothing left to go on with: gril report "
            "draws its page again"
        )
    with writing(path):
        take_lock(path, note=False).close()
    return config


def _read_unchanged(path: Path) -> tuple[RunConfig, Phases]:
    config, phases = read_config(path), read_phases(path)
    if changed := changed_fields(phases.config, config):
        raise RunError(
            f"{path / 'config.yaml'} has been changed since the run began: {', '.join(changed)}"
        )
    return config, phases


def create_or_resume(
    config: RunConfig,
    folder: Path | None,
    *,
    device: str,
    experiment: str,
    begun: Mapping[str, Mapping[str, Any]] | None = None,
) -> RunDir:
    """Resumes the run in a folder, or creates one at `config.run.out` if the folder is None.

    A run that goes on has its own `begun`; errors are those of `create` and `require_resumable`.
    """
    if folder is not None:
        require_resumable(folder, experiment)
        return resume(folder)
    out = Path(config.run.out) if config.run.out else default_path(config.run.seed)
    return create(out, config, device=device, experiment=experiment, begun=begun)


def require_new(path: Path) -> None:
    """Raises RunError if something exists at the path of a new folder."""
    if path.exists() or path.is_symlink():
        raise RunError(f"{path} exists already, but the output must be a new folder")
    above = next(p for p in path.absolute().parents if p.exists())
    if not above.is_dir():
        raise RunError(f"{path} cannot be created, because {above} is a file, not a folder")


def read_config(path: Path) -> RunConfig:
    """Reads a run's configuration."""
    try:
        return load(str(_file(path, "config.yaml")))
    except ConfigError as error:
        raise RunError(str(error)) from None


def _file(path: Path, name: str) -> Path:
    """A file of a run, which need not be there yet; a RunError if the folder is of no run."""
    if not path.is_dir():
        fault = "is a file" if path.exists() else "does not exist"
        raise RunError(f"{path} {fault}, but must be the folder of a run")
    if not (path / "config.yaml").is_file():
        raise RunError(f"{path} is not the folder of a run, because it has no config.yaml")
    return path / name


def read_metrics(path: Path) -> list[dict[str, Any]]:
    """Reads a run's metrics so far, oldest first; an incomplete last line is left out."""
    file = _file(path, "metrics.jsonl")
    try:
        return read_rows(file)
    except FileNotFoundError:
        raise RunError(f"the run in {path} has no metrics yet: it lacks {file.name}") from None
    except OSError as error:
        raise RunError(f"{file} cannot be read ({error})") from None


def read_results(path: Path) -> dict[str, Any]:
    """The results of a finished run; a `RunError` for any other."""
    try:
        return read_object(_file(path, "results.json"))
    except FileNotFoundError:
        raise RunError(f"the run in {path} has not finished: it lacks results.json") from None


def package_versions() -> dict[str, str]:
    """The installed version of each package in `PACKAGES`, or "missing"."""
    found = {}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "missing"
    return found
