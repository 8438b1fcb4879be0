"""The verbs that make tables of named rows: to begin, to go on with a run, to join several.

A table `name` has its rows and settings in `gril_jax.experiments.NAME.rows`, which imports neither
JAX nor MuJoCo, and its `TABLE` in `gril_jax.experiments.NAME.NAME`.
"""

import dataclasses
import functools
import importlib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from gril_jax.config import RunConfig
from gril_jax.errors import ConfigError
from gril_jax.runs import run_dir

from .arguments import (
    Work,
    echo,
    positional,
    require_left_to_options,
    run_config,
    take,
    whole_number,
)
from .heavy_imports import heavy_imports

__all__ = ["VERBS", "made", "not_beside", "redrawn"]

_GOES_ON = (
    " --resume RUN goes on with a run that was cut off; --join A,B --out FOLDER makes one table of "
    "runs with different rows."
)
_ABOUT = {
    "table1": (
        "Train policies with rewards of several kinds (--rows A,B; all by default), --seeds N of "
        "each (5), alike in all else: the paper's Table I and Figure 2. Learned rewards are "
        "audited with --ascents N ascents (1000) from --starts N starts (4). --steps-per-encoder N "
        "trains all encoders for N gradient steps, instead of each as its row says. --quick makes "
        "two rows with two seeds of the configuration quickstart."
    ),
    "table2": (
        "Train encoders in several ways (--rows A,B; all that the configuration allows by "
        "default), --seeds N of each (5), and measure how well their rewards tell success from "
        "failure: the paper's Table II. --quick makes two seeds of the rows without pictures from "
        "fewer demonstrations."
    ),
    "soundness": (
        "Train encoders in several ways (--rows A,B; all by default) with --seeds N seeds each (5 "
        "by default), audit them from --starts N starts (4) with --ascents N ascents (1000), and "
        "train a policy with each, of --steps-per-policy N control steps (the configuration's own; "
        "0 trains none), at most --policies-at-once N in one program (25)."
    ),
    "ablate": (
        "Change each choice of encoder training alone (--rows A,B; all by default), over --seeds N "
        "seeds (5 by default)."
    ),
}


def made(
    name: str,
    config: RunConfig,
    settings: Callable[[], Any],
    resume: Path | None = None,
    connect: Callable[[], None] | None = None,
) -> Work:
    """The table of a new run, or of one to go on with.

    Args:
      name: of the table.
      config: what its rows have in common.
      settings: makes the rest, when JAX may be imported.
      resume: folder of the run to go on with.
      connect: connects the processes of a job, before anything else touches JAX.
    """

    def work() -> None:
        with heavy_imports(config, devices=connect is None):
            if connect is not None:
                connect()
            from gril_jax.experiments.tables import frame

            table = _table(name)
        frame.make(table, config, settings(), resume=resume, echo=echo)

    return work


def redrawn(name: str, folder: Path) -> Work:
    """The page and figures of a finished table, made anew from what its folder holds."""

    def work() -> None:
        with heavy_imports():
            from gril_jax.experiments.tables import results

            table = _table(name)
        results.redraw(table, folder, echo=echo)

    return work


def not_beside(args: list[str], option: str, takes: str) -> None:
    """Raises ConfigError if there is anything beside an option that stands alone."""
    if args:
        raise ConfigError(f"{option} takes {takes}, so {args[0]} must not be given beside it")


def _table(name: str) -> Any:
    folder = "sweeps" if name == "sweep" else name
    return importlib.import_module(f"gril_jax.experiments.{folder}.{name}").TABLE


def _begun(args: list[str], name: str, kind: type) -> Work | None:
    """The work that is left where --resume is given; None without it."""
    from gril_jax.experiments.tables.rows import read_settings

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

    def work() -> None:
        with heavy_imports():
            from gril_jax.experiments.tables import results

            table = _table(name)
        results.join(table, folders, Path(out), echo=echo)

    return work


def _plan(name: str, args: list[str]) -> Work:
    # Names and numbers only: it imports neither JAX nor MuJoCo.
    known = importlib.import_module(f"gril_jax.experiments.{name}.rows")
    other = _begun(args, name, known.Settings) or _joined(args, name)
    if other is not None:
        return other
    quick = hasattr(known, "QUICK_SEEDS") and "--quick" in args
    if quick:
        args.remove("--quick")
    usual = known.Settings(**({"seeds": known.QUICK_SEEDS} if quick else {}))
    numbers = {
        one.name: whole_number(args, f"--{one.name.replace('_', '-')}", getattr(usual, one.name))
        for one in dataclasses.fields(usual)
        if type(getattr(usual, one.name)) is int
    }
    config, chosen = _CHOOSERS[name](known, args, quick)
    settings = dataclasses.replace(usual, **numbers, **chosen)
    return made(name, config, lambda: settings)


def _load(verb: str, name: str | None, args: list[str]) -> RunConfig:
    return run_config(name, args, f"gril {verb}", _ABOUT[verb] + _GOES_ON)


def _rows(known: ModuleType, args: list[str], usual: str | None = None):
    from gril_jax.experiments.tables.rows import chosen_rows

    return chosen_rows(take(args, "--rows") or usual, known.ROWS)


def _table1(known: ModuleType, args: list[str], quick: bool):
    name = positional(args) or ("quickstart" if quick else "match_regions")
    steps = whole_number(args, "--steps-per-encoder", known.QUICK_STEPS if quick else None)
    rows = known.with_steps(_rows(known, args, known.QUICK if quick else None), steps)
    require_left_to_options(args, known.paths(rows))
    # of two the later one counts
    config = _load("table1", name, ["--run.evaluations", str(known.EVALUATIONS), *args])
    known.check(config)
    return config, {"rows": rows}


def _table2(known: ModuleType, args: list[str], quick: bool):
    from gril_jax.experiments.tables.rows import require_learned

    name, every = positional(args), not quick and not any(arg.startswith("--rows") for arg in args)
    rows = _rows(known, args, known.QUICK_ROWS if quick else None)
    usual = known.QUICK if quick else known.USUAL if name is None else {}
    # what is said on the command line counts for more
    args = [f"--{path}={value}" for path, value in usual.items()] + args
    config = _load("table2", name or "shoes_in_box", args)
    require_learned(config)
    return config, {"rows": known.usable(config, echo) if every else rows}


def _soundness(known: ModuleType, args: list[str], quick: bool):
    name, steps = positional(args), whole_number(args, "--steps-per-policy", None, least=0)
    rows = _rows(known, args)
    config = known.with_budget(_load("soundness", name, args), steps)
    return config, {"rows": rows, "policies": steps != 0}


def _ablate(known: ModuleType, args: list[str], quick: bool):
    name, rows = positional(args), _rows(known, args)
    return _load("ablate", name, args), {"rows": rows}


_CHOOSERS: dict[str, Callable[[ModuleType, list[str], bool], tuple[RunConfig, dict[str, Any]]]] = {
    "table1": _table1,
    "table2": _table2,
    "soundness": _soundness,
    "ablate": _ablate,
}

VERBS: dict[str, Callable[[list[str]], Work]] = {
    name: functools.partial(_plan, name) for name in _CHOOSERS
}
