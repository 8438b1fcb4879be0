"""`gril table2`: the paper's Table II."""

from ..arguments import Work
from ..verb import Verb

__all__ = ["VERB"]


def _plan(args: list[str]) -> Work:
    from ..tables import VERBS

    return VERBS["table2"](args)


VERB = Verb(
    "table2 [CONFIG]",
    "the paper's Table II: rewards that tell success from failure; --quick, --resume RUN",
    _plan,
)
