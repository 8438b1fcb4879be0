"""Measures of encoders and of rewards."""

from . import separation
from .order import (
    alignment_tau,
    interquartile_interval,
    interquartile_mean,
    kendall_tau,
    mean_alignment_tau,
    reward_time_tau,
    two_way_cycle_consistency,
)
from .separation import stage_order, success_auc

__all__ = [
    "alignment_tau", "interquartile_interval", "interquartile_mean", "kendall_tau",
    "mean_alignment_tau", "reward_time_tau", "separation", "stage_order",
    "success_auc", "two_way_cycle_consistency",
]  # fmt: skip
