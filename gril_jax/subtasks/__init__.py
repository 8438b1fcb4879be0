"""Stages of a task, found in a learned reward."""

from .agreement import (
    MOST,
    agreed_boundaries,
    agreed_stages,
    each_alone,
    running_median,
    transitions,
)
from .matching import (
    SharedBoundaries,
    boundary_frames,
    match_in_order,
    match_within,
    place_in_order,
    shared_boundaries,
)

__all__ = [
    "MOST", "SharedBoundaries", "agreed_boundaries", "agreed_stages",
    "boundary_frames", "each_alone", "match_in_order", "match_within", "place_in_order",
    "running_median", "shared_boundaries", "transitions",
]  # fmt: skip
