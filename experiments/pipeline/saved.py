"""The reward that a run has saved, read back from its folder."""

from pathlib import Path
from typing import Any

from gril_jax import envs
from gril_jax.config import RunConfig
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.runs.checkpoints import checkpoint

from . import policy_rewards, setup


def learned_reward(folder: Path, config: RunConfig, env: envs.Env) -> RewardParams:
    """The reward that a run has learned.

    Raises:
      RunError: it has none yet, or it is damaged.
    """
    found = checkpoint.newest(folder, "reward")
    return checkpoint.restore(found, setup.blank_reward(config, len(env.classes)))


def policy_reward(folder: Path, config: RunConfig, env: envs.Env) -> Any:
    """The parameters of the reward that a run's policy was trained on.

    Raises:
      RunError: it has none yet, or they are damaged.
    """
    found = checkpoint.newest(folder, "policy_reward")
    return checkpoint.restore(found, policy_rewards.blank(config, env))
