"""Rewards from action-free demonstration videos; policies trained on them, compiled end to end.

The names in `__all__` are loaded when they are first used: importing the package costs nothing.
"""

from .lazy import offer

__version__ = "0.3.0"

_ROOMS = (
    "audit", "config", "demos", "encoders", "graphs", "export", "losses", "metrics",
    "pretraining", "reward", "rl", "subtasks",
)  # fmt: skip
_names, __getattr__ = offer(
    __name__,
    **{room: room for room in _ROOMS}
    | {
        "api": "Audit Rates Subtasks TrainedPolicy audit_reward evaluate find_subtasks "
        "import_videos learn_reward load_demos load_policy make record_demos train_policy",
        "demos.demo_set": "DemoSet",
        "envs": "envs",
        "graphs.scene": "boxes_from_pixels scene_graph",
        "export.reward_file": "load_reward reward_file save_reward",
        "reward.latent_goal": "latent_goal_reward",
        "reward.learned_reward": "LearnedReward",
    },
)
__all__ = ["__version__", *_names]


def __dir__() -> list[str]:
    return __all__
