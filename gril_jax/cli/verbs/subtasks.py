"""`gril subtasks`: stages of a task in a run's learned reward."""

from pathlib import Path

from gril_jax.config.command_line import parse

from ..arguments import Work, run_config_of
from ..verb import Verb, experiment


def _plan(args: list[str]) -> Work:
    from gril_jax.experiments.subtasks.options import Options
    from gril_jax.runs import run_dir

    about = "Find the stages of a task in a learned reward, and cut its demonstrations at them."
    options = parse(Options, args, prog="gril subtasks", description=about)
    folder = Path(options.run)
    run_config_of(folder, "reward")
    out = Path(options.out) if options.out else folder / "subtasks"
    run_dir.require_new(out)
    return experiment("subtasks.report", folder, out, options, devices=True)


VERB = Verb(
    "subtasks RUN", "stages found in a run's learned reward, and demonstrations cut at them", _plan
)
