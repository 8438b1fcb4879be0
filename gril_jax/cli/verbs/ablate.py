"""`gril ablate`: the choices of encoder training, each changed alone."""

from ..arguments import Work, positional, run_config, whole_number
from ..verb import Verb, experiment

__all__ = ["VERB"]


def _plan(args: list[str]) -> Work:
    name, seeds = positional(args), whole_number(args, "--seeds", 5)
    about = "Change each choice of encoder training alone, over --seeds N seeds (5 by default)."
    config = run_config(name, args, "gril ablate", about)
    return experiment("sweeps.ablate", config, seeds, config=config, devices=True)


VERB = Verb("ablate [CONFIG]", "which choices of the reward's training matter, over seeds", _plan)
