"""The verb that makes the paper's Table II."""

import dataclasses
from collections.abc import Callable

from gril_jax.config import RunConfig
from gril_jax.errors import ConfigError

from . import tables
from .arguments import Work, echo, positional, run_config, take, whole_number
from .heavy_imports import heavy_imports

__all__ = ["VERBS"]

_ABOUT = (
    "Train encoders in several ways (--rows A,B; all that the configuration allows by default), "
    "--seeds N of each (5), and measure how well their rewards tell success from failure: the "
    "paper's Table II. --quick makes two seeds of the rows without pictures from fewer "
    "demonstrations. --resume RUN goes on with a run that was cut off."
)


def _table2(args: list[str]) -> Work:
    # Names and numbers only: it imports neither JAX nor MuJoCo.
    from gril_jax.experiments.sweeps import named_rows
    from gril_jax.experiments.table2 import rows as known

    going_on = tables.begun(args, "table2", known.read_settings)
    if going_on is not None:
        return going_on
    quick = "--quick" in args
    if quick:
        args.remove("--quick")
    name = positional(args)
    chosen = take(args, "--rows") or (known.QUICK_ROWS if quick else None)
    seeds = whole_number(args, "--seeds", None)
    usual = known.QUICK if quick else known.USUAL if name is None else {}
    # what is said on the command line counts for more
    args = [f"--{path}={value}" for path, value in usual.items()] + args
    config = run_config(name or "shoes_in_box", args, "gril table2", _ABOUT)
    if config.run.reward != "learned":
        raise ConfigError(
            f"run.reward is {config.run.reward!r}, but must be 'learned' to compare learned rewards"
        )
    rows = named_rows.chosen_rows(chosen, known.ROWS)
    settings = known.Settings(rows, seeds or (known.QUICK_SEEDS if quick else known.Settings.seeds))
    if chosen is None:
        return _of_all_rows(config, settings)
    return tables.made("table2", config, settings)


def _of_all_rows(config: RunConfig, settings) -> Work:
    """With every row that the configuration can have, which takes JAX to find out."""

    def work() -> None:
        with heavy_imports(config, devices=True):
            from gril_jax.experiments.table2 import table2
        rows = table2.usable(config, echo)
        table2.main(config, dataclasses.replace(settings, rows=rows), echo=echo)

    return work


VERBS: dict[str, Callable[[list[str]], Work]] = {"table2": _table2}
