"""Verbs that make tables of named rows: to begin, to go on with a run, to join several.

A table `name` has its rows in `gril_jax.experiments.NAME.rows`, which imports neither JAX nor
MuJoCo, and its `TABLE` in `gril_jax.experiments.NAME.NAME`. The rows' module may have `Settings`.
"""

import dataclasses
import importlib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from gril_jax.config import RunConfig
from gril_jax.errors import ConfigError

from .arguments import Work, echo, run_config, take, whole_number
from .heavy_imports import heavy_imports
from .verb import Verb

Loader = Callable[[str | None, list[str]], RunConfig]  # from a configuration's name and options

_GOES_ON = (
    " --resume RUN goes on with a run that was cut off; --join A,B --out FOLDER makes one table of "
    "runs with different rows."
)


def table(
    name: str,
    summary: str,
    about: str,
    choose: Callable[[ModuleType, list[str], bool, Loader], tuple[RunConfig, dict[str, Any]]],
) -> Verb:
    """The verb of a table.

    Args:
      name: of the table and its verb.
      summary: for the help of `gril`.
      about: for the verb's own.
      choose: from the module of the rows, the arguments, whether --quick is among them, and what
        loads a configuration, makes this and the settings that are not whole numbers.
    """

    def load(config: str | None, args: list[str]) -> RunConfig:
        return run_config(config, args, f"gril {name}", about + _GOES_ON)

    def plan(args: list[str]) -> Work:
        # Names and numbers only: it imports neither JAX nor MuJoCo.
        named_rows = importlib.import_module("gril_jax.experiments.tables.rows")
        known = importlib.import_module(f"gril_jax.experiments.{name}.rows")
        kind = getattr(known, "Settings", named_rows.Settings)
        other = _begun(args, name, kind) or _joined(args, name)
        if other is not None:
            return other
        quick = hasattr(known, "QUICK_SEEDS") and "--quick" in args
        if quick:
            args.remove("--quick")
        usual = kind(known.ROWS, **({"seeds": known.QUICK_SEEDS} if quick else {}))
        numbers = {
            key: whole_number(args, f"--{key.replace('_', '-')}", value)
            for key, value in vars(usual).items()
            if type(value) is int
        }
        config, chosen = choose(known, args, quick, load)
        settings = dataclasses.replace(usual, **numbers, **chosen)
        return made(name, config, lambda: settings)

    return Verb(f"{name} [CONFIG]", summary, plan)


def rows_taken(known: ModuleType, args: list[str], usual: str | None = None):
    """Takes --rows off the arguments; the rows that it names, or the usual ones."""
    from gril_jax.experiments.tables.rows import chosen_rows

    return chosen_rows(take(args, "--rows") or usual, known.ROWS)


def made(
    name: str,
    config: RunConfig,
    settings: Callable[[], Any],
    resume: Path | None = None,
    connect: Callable[[], None] | None = None,
) -> Work:
    """The table of a new run, or of one to go on with.

    `settings` makes what rows do not have in common, when JAX may be imported; `connect`
    connects the processes of a job, before anything else touches JAX.
    """

    def work() -> None:
        with heavy_imports(config, devices=connect is None):
            if connect is not None:
                connect()
            from gril_jax.experiments.tables import frame

            family = _family(name)
        frame.make(family, config, settings(), resume=resume, echo=echo)

    return work


def redrawn(name: str, folder: Path) -> Work:
    """The page and figures of a finished table, made anew from what its folder holds."""
    return _of_results("redraw", name, folder)


def not_beside(args: list[str], option: str, takes: str) -> None:
    """Raises ConfigError if there is anything beside an option that stands alone."""
    if args:
        raise ConfigError(f"{option} takes {takes}, so {args[0]} must not be given beside it")


def _of_results(function: str, name: str, *args: Any) -> Work:
    """The work of a function of `gril_jax.experiments.tables.results`."""

    def work() -> None:
        with heavy_imports():
            from gril_jax.experiments.tables import results

            family = _family(name)
        getattr(results, function)(family, *args, echo=echo)

    return work


def _family(name: str) -> Any:
    folder = "sweeps" if name == "sweep" else name
    return importlib.import_module(f"gril_jax.experiments.{folder}.{name}").TABLE


def _begun(args: list[str], name: str, kind: type) -> Work | None:
    """The work that is left where --resume is given; None without it."""
    from gril_jax.experiments.tables.rows import read_settings
    from gril_jax.runs import run_dir

    given = take(args, "--resume")
    if given is None:
        return None
    not_beside(args, "--resume", f"its options from {given}")
    folder = Path(given)
    config, settings = run_dir.require_resumable(folder, name), read_settings(folder, name, kind)
    return made(name, config, lambda: settings, folder)


def _joined(args: list[str], name: str) -> Work | None:
    """The work where --join is given, with --out beside it; None without it.

    Raises:
      ConfigError: other options are given beside them, or --out is missing.
      RunError: one is no run, or something is where the folder should be.
    """
    from gril_jax.runs import run_dir

    names = take(args, "--join")
    if names is None:
        return None
    out = take(args, "--out")
    not_beside(args, "--join", "--out alone")
    if out is None:
        raise ConfigError("--out is missing, but must name the folder to make for the joined table")
    folders = [Path(folder) for folder in names.split(",")]
    for folder in folders:
        run_dir.read_config(folder)
    run_dir.require_new(Path(out))
    return _of_results("join", name, folders, Path(out))
