"""`gril report`: figures and tables of a run."""

from dataclasses import dataclass
from pathlib import Path

from gril_jax.config.command_line import RunFolder, parse

from ..arguments import Work, run_config_of
from ..verb import Verb, experiment


@dataclass(frozen=True)
class _Options:
    run: RunFolder
    """The folder that a run made."""


def _plan(args: list[str]) -> Work:
    from gril_jax.report import kinds

    from ..tables import redrawn

    given = parse(_Options, args, prog="gril report", description="Draw a run's figures.")
    folder = Path(given.run)
    run_config_of(folder)
    if kinds.made_by(folder) == "table1":
        return redrawn("table1", folder)
    kinds.require_single(folder)
    return experiment("report", folder)


VERB = Verb("report RUN", "figures and tables of a run", _plan)
