"""`gril subtasks`: stages of a task in a run's learned reward."""

from ..arguments import Work
from ..verb import Verb

__all__ = ["VERB"]


def _plan(args: list[str]) -> Work:
    from ..subtasks import VERBS

    return VERBS["subtasks"](args)


VERB = Verb(
    "subtasks RUN",
    "stages found in a run's learned reward, and demonstrations cut at them",
    _plan,
)
