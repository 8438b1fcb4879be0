"""Measures of encoders and of rewards."""

from . import separation
from .order import (
    alignment_tau,
    interquartile_interval,
    interquartile_mean,
    kendall_tau,
    mean_alignment_tau,
    two_way_cycle_consistency,
)
from .ranking import policy_ranking, preference_accuracy
from .separation import stage_order, success_auc
from .time_order import TimeOrder, merge_ties, time_order, voc_pearson, voc_spearman

__all__ = [
    "TimeOrder", "alignment_tau", "interquartile_interval", "interquartile_mean", "kendall_tau",
    "mean_alignment_tau", "merge_ties", "policy_ranking", "preference_accuracy", "separation",
    "stage_order", "success_auc", "time_order", "two_way_cycle_consistency", "voc_pearson",
    "voc_spearman",
]  # fmt: skip
