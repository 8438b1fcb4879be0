"""Sinks: copies of metrics.jsonl for TensorBoard and Weights & Biases, both optional.

    begin(rows)       replaces all rows: called first, and whenever rows have been cut
    log(index, row)   sends one more row, with its number in the file from 0
    close()           sends the remaining rows

A row's finite numbers are sent under PHASE/NAME, at its step. The packages are imported when a sink
is opened.
"""

import hashlib
import importlib
import importlib.util
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gril_jax.errors import ConfigError, RunError

from . import times

PACKAGES = {"tensorboard": "tensorboardX", "wandb": "wandb"}

_STEPS = ("env_steps", "step")  # the names that a row's step may have


def require_installed(names: Sequence[str]) -> None:
    """Raises ConfigError for the first sink whose package is missing; imports nothing."""
    for name in names:
        if importlib.util.find_spec(PACKAGES[name]) is None:
            raise ConfigError(
                f"run.sinks names {name!r}, but the package {PACKAGES[name]} is not installed: "
                f"pip install 'gril-jax[{name}]'"
            )


def open_sink(name: str, folder: Path, config: Mapping[str, Any]) -> "_TensorBoard | _Wandb":
    """Opens a sink for the run in a folder; its own files go to a folder below of its name. A
    ConfigError if its package is not installed, a RunError if it cannot start."""
    require_installed([name])
    return {"tensorboard": _TensorBoard, "wandb": _Wandb}[name](folder, config)


def scalars(row: Mapping[str, Any]) -> tuple[int | None, dict[str, float]]:
    """A row's step, or None, and its numbers by PHASE/NAME."""
    step = next((int(row[name]) for name in _STEPS if row.get(name) is not None), None)
    phase = row.get("phase", "run")
    numbers = {k: v for k, v in row.items() if isinstance(v, int | float) and k not in _STEPS}
    return step, {f"{phase}/{name}": float(value) for name, value in numbers.items()}


class _TensorBoard:
    def __init__(self, folder: Path, config: Mapping[str, Any]):
        self._folder = folder / "tensorboard"
        self._writer: Any = None

    def begin(self, rows: Sequence[Mapping[str, Any]]) -> None:
        self.close()
        shutil.rmtree(self._folder, ignore_errors=True)  # its files can only grow
        package = importlib.import_module(PACKAGES["tensorboard"])
        self._writer = package.SummaryWriter(str(self._folder), flush_secs=10)
        for index, row in enumerate(rows):
            self.log(index, row)

    def log(self, index: int, row: Mapping[str, Any]) -> None:
        step, numbers = scalars(row)
        for name, value in numbers.items():
            self._writer.add_scalar(name, value, index if step is None else step)

    def close(self) -> None:
        if self._writer is not None:
            self._writer.close()


class _Wandb:
    """The W&B sink; a resumed run keeps its identity, and no row is sent twice."""

    def __init__(self, folder: Path, config: Mapping[str, Any]):
        package = importlib.import_module(PACKAGES["wandb"])
        started = times.started(folder) or ""  # with this it names this run and no other
        own = folder / "wandb"
        own.mkdir(exist_ok=True)
        try:
            self._run = package.init(
                project="gril-jax",
                name=folder.name,
                id=hashlib.sha256(f"{folder.name} {started}".encode()).hexdigest()[:16],
                resume="allow",
                dir=str(own),
                config=dict(config),
            )
        except Exception as error:  # of many kinds: no account, no network, no folder
            reason = " ".join(str(error).split()).rstrip(".")
            raise RunError(
                f"wandb cannot start ({reason}): log in, set WANDB_MODE=offline, or leave it out "
                "of run.sinks"
            ) from None

    def begin(self, rows: Sequence[Mapping[str, Any]]) -> None:
        for index, row in enumerate(rows):
            if index >= self._run.step:
                self.log(index, row)

    def log(self, index: int, row: Mapping[str, Any]) -> None:
        step, numbers = scalars(row)
        axis = {} if step is None else {f"{row.get('phase', 'run')}/step": step}
        if index >= self._run.step:
            self._run.log(numbers | axis, step=index)

    def close(self) -> None:
        self._run.finish()
