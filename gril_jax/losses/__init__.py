"""The losses an encoder is trained with, each in its own file."""

from . import heads
from .batch import (
    draw_cycles,
    mean_consistency,
    mean_cycle_consistency,
    sampled_cycle_consistency,
    stochastic_consistency,
)
from .cycle import CycleOptions, cycle_consistency
from .reconstruction import decode, decode_graph, reconstruction
from .soft_dtw import (
    WarpingOptions,
    expected_alignment,
    soft_dtw,
    soft_dtw_between,
    soft_dtw_divergence,
)
from .warping import pairwise_cost

__all__ = [
    "CycleOptions", "WarpingOptions", "cycle_consistency", "decode", "decode_graph", "draw_cycles",
    "expected_alignment", "heads", "mean_consistency", "mean_cycle_consistency", "pairwise_cost",
    "reconstruction", "sampled_cycle_consistency", "soft_dtw", "soft_dtw_between",
    "soft_dtw_divergence", "stochastic_consistency",
]  # fmt: skip
