"""`gril bench train`: the throughput of training, in parts."""

from dataclasses import dataclass, field
from typing import Literal

from gril_jax.config import Variant
from gril_jax.config.rules import count, optional

from ...bench import benchmark


@dataclass(frozen=True)
class _Options:
    num_envs: int | None = field(default=None, metadata=optional(count()))
    """Environments; None is 256 on a CPU and 8,192 elsewhere."""
    variant: Variant = "demo"
    """Quantities randomised at the start of an episode."""
    parts: tuple[Literal["training", "starts", "seeds", "devices"], ...] = (
        "training",
        "starts",
        "seeds",
        "devices",
    )
    """Parts to measure; devices only where there are several."""
    repeats: int = field(default=5, metadata=count())
    """Timed calls of each program."""


VERB = benchmark("train", "training with and without the learned reward", _Options)
