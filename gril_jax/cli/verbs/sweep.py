"""`gril sweep`: many policies at once."""

from ..arguments import Work
from ..verb import Verb

__all__ = ["VERB"]


def _plan(args: list[str]) -> Work:
    from ..sweep import VERBS

    return VERBS["sweep"](args)


VERB = Verb(
    "sweep [CONFIG] --seeds N",
    "every combination of options with commas, over seeds; --distributed on several hosts",
    _plan,
)
