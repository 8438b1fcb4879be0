"""Rewards from action-free demonstration videos; policies trained on them, compiled end to end.

The names in `__all__` are loaded when they are first used: importing the package costs nothing.
"""

from .lazy import offer

__version__ = "0.1.0"

_ROOMS = (
    "audit", "config", "demos", "encoders", "graphs", "export", "losses", "metrics",
    "pretraining", "reward", "rl", "subtasks",
)  # fmt: skip
_names, __getattr__ = offer(
    __name__,
    **{room: room for room in _ROOMS}
    | {
        "api.demos": "load_demos",
        "api.policies": "evaluate load_policy train_policy",
        "api.rewards": "Audit Subtasks audit_reward find_subtasks learn_reward",
        "api.tasks": "make",
        "api.trained_policy": "Rates TrainedPolicy",
        "demos.demo_set": "DemoSet",
        "envs": "envs",
        "graphs.scene": "scene_graph",
        "export.reward_file": "load_reward save_reward",
        "reward.latent_goal": "latent_goal_reward",
        "reward.learned_reward": "LearnedReward",
    },
)
__all__ = ["__version__", *_names]


def __dir__() -> list[str]:
    return __all__
