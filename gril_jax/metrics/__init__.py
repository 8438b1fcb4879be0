"""Measures of encoders and of rewards."""

from . import separation
from .cycles import nearest_frames, three_way_cycle_consistency, two_way_cycle_consistency
from .interquartile import interquartile_interval, interquartile_mean
from .order import (
    alignment_tau,
    kendall_tau,
    mean_alignment_tau,
    monotonicity,
    reward_time_tau,
    separation_ratio,
    step_sharpness,
)
from .separation import stage_order, success_auc

__all__ = [
    "alignment_tau",
    "interquartile_interval",
    "interquartile_mean",
    "kendall_tau",
    "mean_alignment_tau",
    "monotonicity",
    "nearest_frames",
    "reward_time_tau",
    "separation",
    "separation_ratio",
    "stage_order",
    "step_sharpness",
    "success_auc",
    "three_way_cycle_consistency",
    "two_way_cycle_consistency",
]
