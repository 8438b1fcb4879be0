"""Rewards from latents: minus the distance to the goal (Eq. 7), and rewards derived from it."""

from . import chain, pixels, shaping
from .latent_goal import (
    Options,
    RewardParams,
    demo_latents,
    from_demos,
    from_latents,
    latent_goal_reward,
    latent_reward,
)
from .learned_reward import LearnedReward

__all__ = [
    "LearnedReward", "Options", "RewardParams", "chain", "demo_latents", "from_demos",
    "from_latents", "latent_goal_reward", "latent_reward", "pixels", "shaping",
]  # fmt: skip
