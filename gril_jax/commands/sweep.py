"""The verb that trains many policies at once."""

from collections.abc import Callable
from pathlib import Path

from .. import run_dir
from ..config import RunConfig
from ..config_files import load
from ..errors import ConfigError, RunError
from ..sweep_grid import cells, take_axes
from .arguments import Work, echo, heavy_imports, in_full, positional, run_config, take

__all__ = ["VERBS"]

_ABOUT = (
    "Train every combination of the values given, over --seeds N seeds (5 by default). An option "
    "whose value has commas is an axis: --reward learned,environmental --lambda 0.1,1. "
    "--resume RUN goes on with a sweep that was cut off."
)
_PROG = "gril sweep"


def _sweep(args: list[str]) -> Work:
    resume = take(args, "--resume")
    if resume is not None:
        return _resume(Path(resume), args)
    name, seeds = positional(args), take(args, "--seeds")
    if seeds is not None and (not seeds.isdecimal() or int(seeds) < 1):
        raise ConfigError(f"--seeds is {seeds!r}, but must be a whole number of at least 1")
    args[:] = in_full(args)
    axes = take_axes(args)
    config = run_config(name, args, _PROG, _ABOUT)
    found = cells(axes, args, lambda options: load(name, options, prog=_PROG))
    return _work(config, lambda: (found, int(seeds or 5)), None)


def _resume(folder: Path, args: list[str]) -> Work:
    if args:
        raise ConfigError(
            f"--resume takes its options from {folder}, so {args[0]} must not be given beside it"
        )
    config = run_dir.require_resumable(folder, "sweep")
    if not (folder / "sweep.json").is_file():
        raise RunError(f"{folder} is not a sweep: it has no sweep.json")

    def read():
        from ..experiments.sweep import read_cells

        return read_cells(folder)

    return _work(config, read, folder)


def _work(config: RunConfig, read: Callable, resume: Path | None) -> Work:
    def work() -> None:
        with heavy_imports(deterministic=config.run.deterministic):
            from ..experiments import sweep
        found, seeds = read()
        sweep.main(config, found, seeds, resume=resume, echo=echo)

    return work


VERBS: dict[str, Callable[[list[str]], Work]] = {"sweep": _sweep}
