"""The work of the verbs that train: a new run, or one that was cut off."""

from pathlib import Path
from typing import Any

from gril_jax.errors import ConfigError

from .arguments import Work, hard_negatives, resumed_config, run_config, take
from .verb import experiment

_OPTIONS = (
    "--resume RUN goes on with a run that was cut off. --hard-negatives RUN,RUN also learns from "
    "states that the rewards of one or two earlier runs overestimated."
)


def new_run(name: str, of: str | None, args: list[str], prog: str, about: str) -> Work:
    """A new run, or with --resume one that was cut off.

    The configuration `of` has the defaults where None.
    """
    resume, negatives = take(args, "--resume"), take(args, "--hard-negatives")
    extra: dict[str, Any] = {}
    if resume is None:
        config = run_config(of, args, prog, f"{about} {_OPTIONS}")
        if negatives is not None:
            extra["hard_negatives"] = hard_negatives(negatives, config)
    else:
        if negatives is not None:
            raise ConfigError(
                "--hard-negatives is given beside --resume, but a run that goes on has its own"
            )
        extra["resume"] = folder = Path(resume)
        config = resumed_config(folder, of, args, prog=prog, experiment=name)
    return experiment(name, config, config=config, devices=True, **extra)
