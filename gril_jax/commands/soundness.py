"""The verb that compares ways of training encoders by what their rewards can be cheated of."""

from collections.abc import Callable
from pathlib import Path

from ..config import RunConfig
from .arguments import (
    Work,
    echo,
    heavy_imports,
    joined_runs,
    positional,
    resumed_table,
    run_config,
    take,
    whole_number,
)

__all__ = ["VERBS"]

_ABOUT = (
    "Train encoders in several ways (--rows A,B; all by default) with --seeds N seeds each (5 by "
    "default), audit them from --starts N starts (4) with --ascents N ascents (1000), and train a "
    "policy with each, of --steps-per-policy N control steps (the configuration's own; 0 trains "
    "none), at most --policies-at-once N in one program (25). --resume RUN goes on with a run that "
    "was cut off; --join A,B --out FOLDER makes one table of runs with different rows."
)


def _soundness(args: list[str]) -> Work:
    # Names and numbers only: it imports neither JAX nor MuJoCo.
    from ..experiments import soundness_settings as known

    going_on = resumed_table(args, "soundness")
    if going_on is not None:
        folder, config = going_on
        return _work(config, known.read_settings(folder), folder)
    joined = joined_runs(args)
    if joined is not None:
        return _join(*joined)
    name, steps = positional(args), whole_number(args, "--steps-per-policy", None, least=0)
    usual = known.Settings()
    settings = known.Settings(
        rows=known.chosen_rows(take(args, "--rows")),
        seeds=whole_number(args, "--seeds", usual.seeds),
        policies=steps != 0,
        policies_at_once=whole_number(args, "--policies-at-once", usual.policies_at_once),
        ascents=whole_number(args, "--ascents", usual.ascents),
        starts=whole_number(args, "--starts", usual.starts),
    )
    config = known.with_budget(run_config(name, args, "gril soundness", _ABOUT), steps)
    return _work(config, settings, None)


def _join(folders: list[Path], out: Path) -> Work:
    def work() -> None:
        with heavy_imports():
            from ..experiments import soundness
        soundness.join(folders, out, echo=echo)

    return work


def _work(config: RunConfig, settings, resume: Path | None) -> Work:
    def work() -> None:
        with heavy_imports(config):
            from ..experiments import soundness
        soundness.main(config, settings, resume=resume, echo=echo)

    return work


VERBS: dict[str, Callable[[list[str]], Work]] = {"soundness": _soundness}
