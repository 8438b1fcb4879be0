"""`gril soundness`: ways of training encoders, compared by audits and by policies."""

from ..arguments import Work
from ..verb import Verb

__all__ = ["VERB"]


def _plan(args: list[str]) -> Work:
    from ..tables import VERBS

    return VERBS["soundness"](args)


VERB = Verb(
    "soundness [CONFIG]",
    "the same by audits and by policies, and whether audits tell success; "
    "--resume RUN goes on, --join RUN,RUN makes one table",
    _plan,
)
