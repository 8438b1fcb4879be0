"""The verb that makes the paper's Table II."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

from ..config import RunConfig
from ..errors import ConfigError
from .arguments import (
    Work,
    echo,
    heavy_imports,
    positional,
    resumed_table,
    run_config,
    take,
    whole_number,
)

__all__ = ["VERBS"]

_ABOUT = (
    "Train encoders in several ways (--rows A,B; all that the configuration allows by default), "
    "--seeds N of each (5), and measure how well their rewards tell success from failure: the "
    "paper's Table II. --quick makes two seeds of the rows without pictures from fewer "
    "demonstrations. --resume RUN goes on with a run that was cut off."
)


def _table2(args: list[str]) -> Work:
    # Names and numbers only: it imports neither JAX nor MuJoCo.
    from ..experiments import named_rows
    from ..experiments import table2_rows as known

    going_on = resumed_table(args, "table2")
    if going_on is not None:
        folder, config = going_on
        return _work(config, known.read_settings(folder), folder)
    quick = "--quick" in args
    if quick:
        args.remove("--quick")
    name = positional(args) or "shoes_in_box"
    chosen = take(args, "--rows") or (known.QUICK_ROWS if quick else None)
    seeds = whole_number(args, "--seeds", None)
    if quick:  # what is said on the command line counts for more
        args = [f"--{path}={value}" for path, value in known.QUICK.items()] + args
    config = run_config(name, args, "gril table2", _ABOUT)
    if config.run.reward != "learned":
        raise ConfigError(
            f"run.reward is {config.run.reward!r}, but must be 'learned' to compare learned rewards"
        )
    rows = named_rows.chosen_rows(chosen, known.ROWS)
    usual = known.QUICK_SEEDS if quick else known.Settings.seeds
    settings = known.Settings(rows, seeds or usual)
    return _work(config, settings, None, every_row=chosen is None)


def _work(config: RunConfig, settings, resume: Path | None, *, every_row: bool = False) -> Work:
    """Where every row is wanted, those that the configuration cannot have are left out."""

    def work() -> None:
        with heavy_imports(config):
            from ..experiments import table2
        chosen = settings
        if every_row:
            chosen = dataclasses.replace(settings, rows=table2.usable(config, echo))
        table2.main(config, chosen, resume=resume, echo=echo)

    return work


VERBS: dict[str, Callable[[list[str]], Work]] = {"table2": _table2}
