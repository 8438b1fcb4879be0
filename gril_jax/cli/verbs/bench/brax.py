"""`gril bench brax`: our PPO beside brax's own."""

from dataclasses import dataclass, field

from gril_jax.config.rules import count

from ...bench import benchmark


@dataclass(frozen=True)
class _Options:
    seeds: int = field(default=3, metadata=count())
    """Long runs of each."""


VERB = benchmark("brax", "our PPO beside brax's own on one pendulum", _Options)
