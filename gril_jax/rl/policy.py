"""What PPO and SAC have in common of a policy: its value, and how observations are normalised."""

from typing import Any, NamedTuple

import jax.numpy as jnp
from brax.training.acme import running_statistics, specs
from jaxtyping import Array, Float

__all__ = ["MAX_OBSERVATION", "Policy", "fresh_normalizer", "normalize"]

# In standard deviations. An input that was constant so far, such as the speed of a block that
# nobody has touched, has one of 1e-6: without a limit its first change enters the networks as a
# million.
MAX_OBSERVATION = 10.0


class Policy(NamedTuple):
    """Enough to act: observation statistics and the policy network's weights."""

    normalizer: running_statistics.RunningStatisticsState
    params: Any


def fresh_normalizer(observation_size: int) -> running_statistics.RunningStatisticsState:
    """Statistics of no observation yet: mean 0 and deviation 1."""
    return running_statistics.init_state(specs.Array((observation_size,), jnp.dtype("float32")))


def normalize(
    observation: Float[Array, "*batch O"],
    statistics: running_statistics.RunningStatisticsState,
) -> Float[Array, "*batch O"]:
    """Observations in standard deviations from their mean, at most `MAX_OBSERVATION` of them."""
    return running_statistics.normalize(observation, statistics, max_abs_value=MAX_OBSERVATION)
