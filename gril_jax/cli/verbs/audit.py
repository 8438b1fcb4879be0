"""`gril audit`: ways in which a reward could be hacked."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from gril_jax.config import TaskName, Variant
from gril_jax.config.command_line import parse
from gril_jax.config.rules import between, count
from gril_jax.errors import RunError

from ..arguments import Work, run_config_of
from ..verb import Verb, experiment


@dataclass(frozen=True)
class _Options:
    reward: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="REWARD_OR_RUN")]
    """A file of export-reward, or a run's folder."""
    task: TaskName | None = None
    """The task; by default the run's own, or match_regions."""
    out: str | None = None
    """Folder for the results; by default RUN/audit, or NAME-audit beside NAME.npz."""
    variant: Variant | None = None
    """Quantities randomised at the start; None keeps the run's own variant."""
    ascents: int = field(default=1000, metadata=count())
    """Gradient ascents of the search for states with a high reward and no progress."""
    starts: int = field(default=4, metadata=count())
    """Starts of episodes, around which all states are made."""
    seed: int = field(default=0, metadata=between(0, 2**31 - 1))
    """Seed of all randomness."""


def _plan(args: list[str]) -> Work:
    from gril_jax.config.files import load

    about = "Find how a learned reward could be hacked, before a policy does."
    given = parse(_Options, args, prog="gril audit", description=about)
    source = Path(given.reward)
    config = load(given.task) if given.task else None  # XLA's options depend on the task
    if source.is_dir():
        config = run_config_of(source, "reward")
    elif not source.is_file():
        raise RunError(f"{source} does not exist, but must be a reward file or the folder of a run")
    out = None if given.out is None else Path(given.out)
    if out is not None and out.exists() and not out.is_dir():
        raise RunError(f"{out} is a file, but --out must be a folder")
    options = vars(given) | {"out": out}
    del options["reward"]
    return experiment("audit", source, config=config, devices=True, **options)


VERB = Verb("audit RUN|REWARD", "how a reward could be hacked, before a policy finds it", _plan)
