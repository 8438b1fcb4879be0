"""`gril bench env`: the throughput of a task."""

from dataclasses import dataclass, field

from gril_jax.config import TaskName
from gril_jax.config.rules import count, optional

from ...bench import benchmark


@dataclass(frozen=True)
class _Options:
    task: TaskName = "match_regions"
    """The task to step."""
    num_envs: int | None = field(default=None, metadata=optional(count()))
    """Episodes in parallel; None is 256 on a CPU, and elsewhere 32,768, or 4,096 for the shoes."""
    steps: int = field(default=20, metadata=count())
    """Control steps of each timed run."""
    settings: bool = False
    """Measure every setting of the solver, and other engines, instead of the default alone."""


VERB = benchmark("env", "how many control steps a second the task makes here", _Options)
