"""The verb that makes the paper's Table I and Figure 2."""

from collections.abc import Callable
from pathlib import Path

from ..config import RunConfig
from .arguments import (
    Work,
    echo,
    heavy_imports,
    joined_runs,
    positional,
    require_left_to_options,
    resumed_table,
    run_config,
    take,
    whole_number,
)

__all__ = ["VERBS"]

_ABOUT = (
    "Train policies with rewards of several kinds (--rows A,B; all by default), --seeds N of each "
    "(5), alike in all else: the paper's Table I and Figure 2. Learned rewards are audited with "
    "--ascents N ascents (1000) from --starts N starts (4). --steps-per-encoder N trains all "
    "encoders for N gradient steps, instead of each as its row says. --quick makes two rows with "
    "two seeds of the configuration quickstart. --resume RUN goes on with a run that was cut off; "
    "--join A,B --out FOLDER makes one table of runs with different rows."
)
_PROG = "gril table1"


def _table1(args: list[str]) -> Work:
    # Names and numbers only: it imports neither JAX nor MuJoCo.
    from ..experiments import table1_rows as known

    going_on = resumed_table(args, "table1")
    if going_on is not None:
        folder, config = going_on
        return _work(config, known.read_settings(folder), folder)
    joined = joined_runs(args)
    if joined is not None:
        return _join(*joined)
    quick = "--quick" in args
    if quick:
        args.remove("--quick")
    name = positional(args) or ("quickstart" if quick else "match_regions")
    rows = take(args, "--rows") or (known.QUICK if quick else None)
    steps = whole_number(args, "--steps-per-encoder", known.QUICK_STEPS if quick else None)
    usual = known.Settings()
    settings = known.Settings(
        rows=known.chosen_rows(rows, encoder_steps=steps),
        seeds=whole_number(args, "--seeds", known.QUICK_SEEDS if quick else usual.seeds),
        ascents=whole_number(args, "--ascents", usual.ascents),
        starts=whole_number(args, "--starts", usual.starts),
    )
    require_left_to_options(args, known.paths(settings.rows))
    evaluations = known.QUICK_EVALUATIONS if quick else known.EVALUATIONS
    args = ["--run.evaluations", str(evaluations), *args]  # of two the later one counts
    config = run_config(name, args, _PROG, _ABOUT)
    known.check(config)
    return _work(config, settings, None)


def _join(folders: list[Path], out: Path) -> Work:
    def work() -> None:
        with heavy_imports():
            from ..experiments import table1
        table1.join(folders, out, echo=echo)

    return work


def _work(config: RunConfig, settings, resume: Path | None) -> Work:
    def work() -> None:
        with heavy_imports(config):
            from ..experiments import table1
        table1.main(config, settings, resume=resume, echo=echo)

    return work


VERBS: dict[str, Callable[[list[str]], Work]] = {"table1": _table1}
