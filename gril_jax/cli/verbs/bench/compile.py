"""`gril bench compile`: what a run compiles."""

from dataclasses import dataclass

from ...bench import benchmark


@dataclass(frozen=True)
class _Options:
    config: str = "quickstart"
    """Configuration whose programs are compiled."""


VERB = benchmark(
    "compile", "seconds to compile each program of a run, and how many there are", _Options
)
