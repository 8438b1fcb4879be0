"""The verb that makes the paper's Table I and Figure 2."""

from collections.abc import Callable

from . import tables
from .arguments import Work, positional, require_left_to_options, run_config, take, whole_number

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
    from gril_jax.experiments.table1 import rows as known

    other = tables.begun(args, "table1", known.read_settings) or tables.joined(args, "table1")
    if other is not None:
        return other
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
    return tables.made("table1", config, settings)


VERBS: dict[str, Callable[[list[str]], Work]] = {"table1": _table1}
