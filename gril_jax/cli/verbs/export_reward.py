"""`gril export-reward`: a run's reward as one file."""

from dataclasses import dataclass
from pathlib import Path

from gril_jax.config.command_line import RunFolder, parse

from ..arguments import Work, require_new_file, run_config_of
from ..verb import Verb, experiment


@dataclass(frozen=True)
class _Options:
    run: RunFolder
    """The folder that a run made."""
    out: str
    """File to create, such as reward.npz."""


def _plan(args: list[str]) -> Work:
    about = "Write a run's learned reward as one file, which load_reward reads."
    given = parse(_Options, args, prog="gril export-reward", description=about)
    folder, out = Path(given.run), Path(given.out)
    run_config_of(folder, "reward")
    require_new_file(out)
    return experiment("export_reward", folder, out)


VERB = Verb("export-reward RUN", "a run's reward as one file that load_reward reads", _plan)
