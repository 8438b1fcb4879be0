"""Trains a policy from a reward and a task, in one compiled step."""

from . import rewards
from .evaluate import Evaluation
from .policy import Policy
from .ppo import PPO
from .sac import SAC
from .training import Algorithm

__all__ = ["PPO", "SAC", "Algorithm", "Evaluation", "Policy", "rewards"]
