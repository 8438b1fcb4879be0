"""Audits of rewards: searches for states with high reward and no success."""

from .ascent import Found, kept, search
from .measures import Audit, Measures, audit, measure
from .scene_reward import Scene, SceneReward, activity_bits, scene_reward
from .shortfalls import KINDS, is_clear_success, kind_of
from .states import FACTORS, Battery, battery, orders

__all__ = [
    "FACTORS", "KINDS", "Audit", "Battery", "Found", "Measures", "Scene", "SceneReward",
    "activity_bits", "audit", "battery", "is_clear_success", "kept", "kind_of", "measure", "orders",
    "scene_reward", "search",
]  # fmt: skip
