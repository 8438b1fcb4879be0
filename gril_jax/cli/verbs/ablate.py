"""`gril ablate`: the choices of encoder training, each changed alone."""

from ..arguments import Work
from ..verb import Verb

__all__ = ["VERB"]


def _plan(args: list[str]) -> Work:
    from ..tables import VERBS

    return VERBS["ablate"](args)


VERB = Verb("ablate [CONFIG]", "which choices of the reward's training matter, over seeds", _plan)
