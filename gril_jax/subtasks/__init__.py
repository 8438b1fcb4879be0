"""Stages of a task, found in a learned reward."""

from .agreement import MOST, AgreedBoundaries, agreed_boundaries, agreed_stages, each_alone
from .boundaries import (
    gaussian_smooth,
    gradient_peaks,
    peak_prominences,
    running_median,
    segments,
    transitions,
)
from .matching import (
    BoundaryScore,
    SharedBoundaries,
    boundary_frames,
    boundary_score,
    match_in_order,
    place_in_order,
    shared_boundaries,
)

__all__ = [
    "MOST",
    "AgreedBoundaries",
    "BoundaryScore",
    "SharedBoundaries",
    "agreed_boundaries",
    "agreed_stages",
    "boundary_frames",
    "boundary_score",
    "each_alone",
    "gaussian_smooth",
    "gradient_peaks",
    "match_in_order",
    "peak_prominences",
    "place_in_order",
    "running_median",
    "segments",
    "shared_boundaries",
    "transitions",
]
