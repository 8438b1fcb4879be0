"""`gril bench known`: returns where good ones are known."""

from dataclasses import dataclass, field
from typing import Literal

from gril_jax.config.rules import count, optional

from ...bench import benchmark


@dataclass(frozen=True)
class _Options:
    tasks: tuple[Literal["pendulum", "inverted_pendulum", "reacher"], ...] = (
        "pendulum",
        "inverted_pendulum",
        "reacher",
    )
    """Tasks to train on."""
    algorithms: tuple[Literal["ppo", "sac"], ...] = ("ppo", "sac")
    """Algorithms to train with."""
    seeds: int = field(default=3, metadata=count())
    """Runs of each."""
    jobs: int | None = field(default=None, metadata=optional(count()))
    """Processes at a time; None is one for every two processor cores."""


VERB = benchmark(
    "known", "PPO and SAC where good returns are known, beside brax's and published", _Options
)
