"""Rewards from latents: minus the distance to the goal (Eq. 7), and rewards derived from it."""

from . import pixels, shaping
from .latent_goal import (
    RewardParams,
    demo_latents,
    from_demos,
    from_latents,
    latent_goal_reward,
    latent_reward,
)
from .learned_reward import LearnedReward

__all__ = [
    "LearnedReward", "RewardParams", "demo_latents", "from_demos", "from_latents",
    "latent_goal_reward", "latent_reward", "pixels", "shaping",
]  # fmt: skip
