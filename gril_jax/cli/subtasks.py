"""The verb that finds the stages of a task in a run's learned reward."""

from collections.abc import Callable
from pathlib import Path

from gril_jax.config.command_line import parse
from gril_jax.errors import RunError
from gril_jax.runs import run_dir

from .arguments import Work, echo
from .heavy_imports import heavy_imports

__all__ = ["VERBS"]

_ABOUT = "Find the stages of a task in a learned reward, and cut its demonstrations at them."


def _subtasks(args: list[str]) -> Work:
    from gril_jax.experiments.subtasks.options import Options

    options = parse(Options, args, prog="gril subtasks", description=_ABOUT)
    options.check()
    folder = Path(options.run)
    run_dir.read_config(folder)
    if not any(folder.glob("reward/[0-9]*/manifest.json")):
        raise RunError(f"{folder} has no reward, so its run has not got that far yet")
    out = Path(options.out) if options.out else folder / "subtasks"
    run_dir.require_new(out)

    def work() -> None:
        with heavy_imports(devices=True):
            from gril_jax.experiments.subtasks import report
        report.main(folder, out, options, echo=echo)

    return work


VERBS: dict[str, Callable[[list[str]], Work]] = {"subtasks": _subtasks}
