"""Audits of rewards: searches for states with high reward and no progress."""

from .ascent import Found, search
from .measures import Audit, Measures, audit, measure
from .scene_reward import Scene, SceneReward, activity_bits, scene_reward
from .states import FACTORS, Battery, battery, orders

__all__ = [
    "FACTORS", "Audit", "Battery", "Found", "Measures", "Scene", "SceneReward", "activity_bits",
    "audit", "battery", "measure", "orders", "scene_reward", "search",
]  # fmt: skip
