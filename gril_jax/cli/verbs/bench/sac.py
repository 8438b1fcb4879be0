"""`gril bench sac`: our SAC beside a loop on the host."""

from dataclasses import dataclass, field

from gril_jax.config.rules import above, count, optional

from ...bench import benchmark


@dataclass(frozen=True)
class _Options:
    num_envs: int = field(default=64, metadata=count())
    """Number of our environments that are stepped together."""
    target: float | None = field(default=None, metadata=optional(above(0)))
    """Success rate of training episodes to reach; None measures speeds only."""


VERB = benchmark("sac", "our SAC beside a loop on the host, as with Gymnasium", _Options)
