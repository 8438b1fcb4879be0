"""The verbs of the command line, by what they are about."""

from . import bench, demos, runs

__all__ = ["VERBS"]

VERBS = runs.VERBS | demos.VERBS | bench.VERBS
