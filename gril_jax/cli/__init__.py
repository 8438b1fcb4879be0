"""The verbs of the command line, by what they are about."""

from . import audit, bench, demos, runs, subtasks, sweep, tables

__all__ = ["VERBS"]

VERBS = (
    runs.VERBS
    | demos.VERBS
    | bench.VERBS
    | audit.VERBS
    | sweep.VERBS
    | tables.VERBS
    | subtasks.VERBS
)
