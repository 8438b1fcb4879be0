"""`gril pretrain`: a learned reward."""

from ..arguments import Work, positional
from ..new_run import new_run
from ..verb import Verb


def _plan(args: list[str]) -> Work:
    return new_run("pretrain", positional(args), args, "gril pretrain", "Learn a reward.")


VERB = Verb("pretrain [CONFIG]", "the learned reward alone", _plan)
