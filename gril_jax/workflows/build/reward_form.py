"""A form of the reward: from a configuration to a function, and to its parameters."""

from collections.abc import Callable
from typing import Any, NamedTuple

from gril_jax import envs
from gril_jax.config import RunConfig
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.rl import rewards
from gril_jax.types import DemoBatch


class RewardForm(NamedTuple):
    """One entry of the table `REWARDS`."""

    function: Callable[[RunConfig, envs.Env], rewards.AnyReward]
    """The reward as the algorithms take it."""
    parameters: Callable[[RunConfig, RewardParams, DemoBatch | None, int], Any]
    """Its parameters, from a learned reward, the demonstrations that it was learned from (None for
    shapes alone), and the number of classes."""
