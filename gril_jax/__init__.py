"""Rewards from action-free demonstration videos; policies trained on them, compiled end to end.

The names in `__all__` are loaded when they are first used: importing the package costs nothing.
"""

from .lazy import offer

__version__ = "0.1.0"

_ROOMS = (
    "audit", "config", "demos", "encoders", "envs", "graphs", "interop", "losses", "metrics",
    "pretraining", "reward", "rl", "subtasks",
)  # fmt: skip
_HOMES = {room: room for room in _ROOMS} | {
    "LearnedReward": "reward.learned_reward",
    "latent_goal_reward": "reward.latent_goal",
    "load_demo_set": "demos.demo_set",
    "load_reward": "interop.reward_file",
    "make": "envs",
    "reward_file": "interop.reward_file",
    "save_demo_set": "demos.demo_set",
    "save_reward": "interop.reward_file",
    "scene_graph": "graphs.scene",
}

__all__ = ["__version__", *sorted(_HOMES)]

__getattr__ = offer(__name__, _HOMES)


def __dir__() -> list[str]:
    return __all__
