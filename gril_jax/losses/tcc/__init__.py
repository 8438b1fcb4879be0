"""Temporal cycle-consistency; one module for each form."""

from .batch import mean_consistency, mean_cycle_consistency
from .cycle import cycle_consistency, frame_times, time_agreement
from .stochastic import draw_cycles, sampled_cycle_consistency, stochastic_consistency

__all__ = [
    "cycle_consistency",
    "draw_cycles",
    "frame_times",
    "mean_consistency",
    "mean_cycle_consistency",
    "sampled_cycle_consistency",
    "stochastic_consistency",
    "time_agreement",
]
