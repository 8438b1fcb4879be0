"""Scene graphs from object boxes, and activity bits of moved objects (Eq. 4)."""

from . import activity
from .activity_rule import PAPER, ActivityRule
from .pair_statistics import pair_statistics
from .scene import boxes_from_pixels, edge_indices, safe_norm, scene_graph

__all__ = [
    "PAPER", "ActivityRule", "activity", "boxes_from_pixels", "edge_indices",
    "pair_statistics", "safe_norm", "scene_graph",
]  # fmt: skip
