"""Rewards from action-free demonstration videos; policies trained on them, compiled end to end.

The names in `__all__` are loaded when they are first used: importing the package costs nothing.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

# A public name, and where it is defined. A module's own name stands for the module.
_HOMES = {
    "LearnedReward": "reward.learned_reward",
    "latent_goal_reward": "reward.latent_goal",
    "load_demo_set": "demos.demo_set",
    "load_reward": "interop.reward_file",
    "make": "envs",
    "save_reward": "interop.reward_file",
    "scene_graph": "graphs.scene",
}
_MODULES = {"reward_file": "interop.reward_file"} | {
    name: name
    for name in (
        "audit", "config", "demos", "encoders", "envs", "graphs", "interop", "losses", "metrics",
        "pretraining", "reward", "rl", "subtasks",
    )
}  # fmt: skip

__all__ = ["__version__", *sorted([*_HOMES, *_MODULES])]


def __getattr__(name: str) -> Any:
    """A public name or module, imported now."""
    if name in _MODULES:
        return import_module(f"gril_jax.{_MODULES[name]}")
    if name in _HOMES:
        return getattr(import_module(f"gril_jax.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'gril_jax' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
