"""`gril table1`: the paper's Table I and Figure 2."""

from ..arguments import Work
from ..verb import Verb

__all__ = ["VERB"]


def _plan(args: list[str]) -> Work:
    from ..tables import VERBS

    return VERBS["table1"](args)


VERB = Verb(
    "table1 [CONFIG]",
    "the paper's Table I and Figure 2: policies with rewards of all kinds; "
    "--quick on a laptop, --resume RUN goes on",
    _plan,
)
