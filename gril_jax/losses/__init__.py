"""The losses an encoder is trained with, each in its own file."""

from .reconstruction import decode, decode_graph, reconstruction, reconstruction_terms
from .tcc.batch import mean_consistency, mean_cycle_consistency
from .tcc.cycle import cycle_consistency, frame_times, time_agreement
from .tcc.stochastic import draw_cycles, sampled_cycle_consistency, stochastic_consistency
from .time_warping.soft_dtw import (
    dtw,
    dtw_path,
    expected_alignment,
    pairwise_cost,
    soft_dtw,
    soft_dtw_between,
    soft_dtw_divergence,
)

__all__ = [
    "cycle_consistency", "decode", "decode_graph", "draw_cycles", "dtw", "dtw_path",
    "expected_alignment", "frame_times", "mean_consistency", "mean_cycle_consistency",
    "pairwise_cost", "reconstruction", "reconstruction_terms", "sampled_cycle_consistency",
    "soft_dtw", "soft_dtw_between", "soft_dtw_divergence", "stochastic_consistency",
    "time_agreement",
]  # fmt: skip
