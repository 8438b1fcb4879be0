"""The verb that finds the stages of a task in a run's learned reward."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from gril_jax.config.command_line import parse
from gril_jax.errors import ConfigError, RunError
from gril_jax.runs import run_dir

from .arguments import Work, echo
from .heavy_imports import heavy_imports

__all__ = ["VERBS"]


@dataclass(frozen=True)
class _Subtasks:
    run: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """The folder of a run that has learned a reward."""
    out: str | None = None
    """New folder for the results; None for `subtasks` in the run's folder."""
    prominence: float = 0.125
    """Least height of a stage's rise; a learned reward goes from about -1 to 0."""
    smoothing: int = 15
    """Frames of the running median of the reward, odd."""
    patience: int | None = None
    """Frames without progress that end a stage; None finds what demonstrations agree with."""
    support: float = 0.5
    """Least share of the demonstrations that must show a stage's end by themselves."""
    tolerance: int | None = None
    """Frames by which a found end may miss a true one; None is one second."""
    figures: int = 3
    """Held-out demonstrations that are drawn."""
    sets: bool = False
    """Write each subtask's demonstrations as a set of their own, films included."""


def _subtasks(args: list[str]) -> Work:
    about = "Find the stages of a task in a learned reward, and cut its demonstrations at them."
    given = parse(_Subtasks, args, prog="gril subtasks", description=about)
    _check(given)
    folder = Path(given.run)
    run_dir.read_config(folder)
    if not any(folder.glob("reward/[0-9]*/manifest.json")):
        raise RunError(f"{folder} has no reward, so its run has not got that far yet")
    out = Path(given.out) if given.out else folder / "subtasks"
    run_dir.require_new(out)

    def work() -> None:
        with heavy_imports(devices=True):
            from gril_jax.experiments.subtasks import report as subtask_report
        rule = subtask_report.Rule(given.prominence, given.smoothing, given.patience, given.support)
        subtask_report.main(
            folder, out, rule,
            tolerance=given.tolerance, figures=given.figures, sets=given.sets, echo=echo,
        )  # fmt: skip

    return work


def _check(given: _Subtasks) -> None:
    rules = {
        "prominence": (given.prominence > 0, "above 0"),
        "smoothing": (given.smoothing >= 1 and given.smoothing % 2 == 1, "odd and at least 1"),
        "patience": (given.patience is None or given.patience >= 1, "at least 1"),
        "support": (0 < given.support <= 1, "above 0 and at most 1"),
        "tolerance": (given.tolerance is None or given.tolerance >= 0, "at least 0"),
        "figures": (given.figures >= 0, "at least 0"),
    }
    for name, (holds, text) in rules.items():
        if not holds:
            raise ConfigError(f"--{name} is {getattr(given, name)}, but must be {text}")


VERBS: dict[str, Callable[[list[str]], Work]] = {"subtasks": _subtasks}
