"""Soft-DTW and DTW: the problem, its solvers, and the functions that call them."""

from .dtw import dtw, dtw_path
from .soft_dtw import (
    expected_alignment,
    pairwise_cost,
    soft_dtw,
    soft_dtw_between,
    soft_dtw_divergence,
)

__all__ = [
    "dtw",
    "dtw_path",
    "expected_alignment",
    "pairwise_cost",
    "soft_dtw",
    "soft_dtw_between",
    "soft_dtw_divergence",
]
