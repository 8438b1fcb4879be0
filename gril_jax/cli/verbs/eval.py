"""`gril eval`: success rate and return of a run's policy."""

from dataclasses import dataclass, field
from pathlib import Path

from gril_jax.config import Variant
from gril_jax.config.command_line import RunFolder, parse
from gril_jax.config.rules import between, count

from ..arguments import Work, run_config_of
from ..verb import Verb, experiment


@dataclass(frozen=True)
class _Options:
    run: RunFolder
    """The folder that a run made."""
    episodes: int = field(default=100, metadata=count())
    """Episodes to play."""
    seed: int = field(default=0, metadata=between(0, 2**31 - 1))
    """Seed of the episodes."""
    variant: Variant | None = None
    """Quantities randomised at the start; None keeps the run's own variant."""


def _plan(args: list[str]) -> Work:
    given = parse(_Options, args, prog="gril eval", description="Play a run's policy.")
    folder = Path(given.run)
    config, options = run_config_of(folder), vars(given).copy()
    del options["run"]
    return experiment("evaluate", folder, config=config, devices=True, **options)


VERB = Verb("eval RUN", "success rate and return of a run's policy", _plan)
