"""The losses an encoder is trained with, each in its own file."""

from .reconstruction import decode, decode_graph, reconstruction
from .tcc.batch import mean_consistency, mean_cycle_consistency
from .tcc.cycle import CycleOptions, cycle_consistency
from .tcc.stochastic import draw_cycles, sampled_cycle_consistency, stochastic_consistency
from .time_warping.soft_dtw import (
    WarpingOptions,
    expected_alignment,
    pairwise_cost,
    soft_dtw,
    soft_dtw_between,
    soft_dtw_divergence,
)

__all__ = [
    "CycleOptions", "WarpingOptions", "cycle_consistency", "decode", "decode_graph", "draw_cycles",
    "expected_alignment", "mean_consistency", "mean_cycle_consistency", "pairwise_cost",
    "reconstruction", "sampled_cycle_consistency", "soft_dtw", "soft_dtw_between",
    "soft_dtw_divergence", "stochastic_consistency",
]  # fmt: skip
