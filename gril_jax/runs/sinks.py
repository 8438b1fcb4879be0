"""Sinks: copies of metrics.jsonl for TensorBoard and Weights & Biases, both optional.

`log` sends one row, with its number in the file from 0; `close` sends what remains. A row's finite
numbers are sent under PHASE/NAME, at its step. Where rows are cut, a sink is opened again.
"""

import hashlib
import importlib
import importlib.util
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gril_jax.errors import ConfigError, RunError

from .json_lines import Row, started

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


def open_sink(
    name: str, folder: Path, config: Mapping[str, Any], rows: Sequence[Row]
) -> "_TensorBoard | _Wandb":
    """Opens a sink for the run in a folder, with its rows so far; the sink's own files go to a
    folder below of its name. A ConfigError if its package is not installed, a RunError if it cannot
    start."""
    require_installed([name])
    sink = {"tensorboard": _TensorBoard, "wandb": _Wandb}[name](folder, config)
    for index, row in enumerate(rows):
        sink.log(index, row)
    return sink


def scalars(row: Row) -> tuple[int | None, dict[str, float]]:
    """A row's step, or None, and its numbers by PHASE/NAME."""
    step = next((int(row[name]) for name in _STEPS if row.get(name) is not None), None)
    phase = row.get("phase", "run")
    numbers = {k: v for k, v in row.items() if isinstance(v, int | float) and k not in _STEPS}
    return step, {f"{phase}/{name}": float(value) for name, value in numbers.items()}


class _TensorBoard:
    def __init__(self, folder: Path, config: Mapping[str, Any]):
        del config
        shutil.rmtree(folder / "tensorboard", ignore_errors=True)  # its files can only grow
        package = importlib.import_module(PACKAGES["tensorboard"])
        self._writer = package.SummaryWriter(str(folder / "tensorboard"), flush_secs=10)

    def log(self, index: int, row: Row) -> None:
        step, numbers = scalars(row)
        for name, value in numbers.items():
            self._writer.add_scalar(name, value, index if step is None else step)

    def close(self) -> None:
        self._writer.close()


class _Wandb:
    """The W&B sink; a resumed run keeps its identity, and no row is sent twice."""

    def __init__(self, folder: Path, config: Mapping[str, Any]):
        package = importlib.import_module(PACKAGES["wandb"])
        identity = f"{folder.name} {started(folder) or ''}"  # names this run and no other
        (folder / "wandb").mkdir(exist_ok=True)
        try:
            self._run = package.init(
                project="gril-jax", name=folder.name, resume="allow", config=dict(config),
                id=hashlib.sha256(identity.encode()).hexdigest()[:16], dir=str(folder / "wandb"),
            )  # fmt: skip
        except Exception as error:  # of many kinds: no account, no network, no folder
            reason = " ".join(str(error).split()).rstrip(".")
            raise RunError(
                f"wandb cannot start ({reason}): log in, set WANDB_MODE=offline, or leave it out "
                "of run.sinks"
            ) from None

    def log(self, index: int, row: Row) -> None:
        step, numbers = scalars(row)
        axis = {} if step is None else {f"{row.get('phase', 'run')}/step": step}
        if index >= self._run.step:
            self._run.log(numbers | axis, step=index)

    def close(self) -> None:
        self._run.finish()
