"""The verb that compares ways of training encoders by what their rewards can be cheated of."""

from collections.abc import Callable

from . import tables
from .arguments import Work, positional, run_config, take, whole_number

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
    from gril_jax.experiments.soundness import settings as known

    other = tables.begun(args, "soundness", known.read_settings)
    other = other or tables.joined(args, "soundness")
    if other is not None:
        return other
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
    return tables.made("soundness", config, settings)


VERBS: dict[str, Callable[[list[str]], Work]] = {"soundness": _soundness}
