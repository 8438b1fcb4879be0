"""What the verbs that make tables have in common: to begin, to go on with a run, to join several.

A table `name` is made by `experiments/name.py`: its `main(config, settings, resume=, echo=)`, and
`join(folders, out, echo=)` where runs can be joined.
"""

import importlib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from gril_jax.config import RunConfig
from gril_jax.errors import ConfigError
from gril_jax.runs import run_dir

from .arguments import Work, echo, take
from .heavy_imports import heavy_imports

__all__ = ["begun", "joined", "made"]


def made(name: str, config: RunConfig, settings: Any, resume: Path | None = None) -> Work:
    """The table of a new run, or of one to go on with."""

    def work() -> None:
        with heavy_imports(config, devices=True):
            table = _experiment(name)
        table.main(config, settings, resume=resume, echo=echo)

    return work


def begun(args: list[str], name: str, read_settings: Callable[[Path], Any]) -> Work | None:
    """What to do where --resume is given; None without it.

    Raises:
      ConfigError: other options are given beside it.
      RunError: the experiment cannot go on with that run.
    """
    folder = take(args, "--resume")
    if folder is None:
        return None
    if args:
        raise ConfigError(
            f"--resume takes its options from {folder}, so {args[0]} must not be given beside it"
        )
    config = run_dir.require_resumable(Path(folder), name)
    return made(name, config, read_settings(Path(folder)), Path(folder))


def joined(args: list[str], name: str) -> Work | None:
    """What to do where --join is given, with --out beside it; None without it.

    Raises:
      ConfigError: other options are given beside them, or --out is missing.
      RunError: one is no run, or something is where the folder should be.
    """
    names = take(args, "--join")
    if names is None:
        return None
    out = take(args, "--out")
    if args:
        raise ConfigError(f"--join takes --out alone, so {args[0]} must not be given beside it")
    if out is None:
        raise ConfigError("--out is missing, but must name the folder to make for the joined table")
    folders = [Path(folder) for folder in names.split(",")]
    for folder in folders:
        run_dir.read_config(folder)
    run_dir.require_new(Path(out))

    def work() -> None:
        with heavy_imports():
            table = _experiment(name)
        table.join(folders, Path(out), echo=echo)

    return work


def _experiment(name: str) -> ModuleType:
    return importlib.import_module(f"gril_jax.experiments.{name}.{name}")
