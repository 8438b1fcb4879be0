"""The verbs of the command line, by what they are about."""

from . import audit, bench, demos, runs, soundness, subtasks, sweep, table1, table2

__all__ = ["VERBS"]

VERBS = (
    runs.VERBS
    | demos.VERBS
    | bench.VERBS
    | audit.VERBS
    | sweep.VERBS
    | soundness.VERBS
    | table1.VERBS
    | table2.VERBS
    | subtasks.VERBS
)
