"""The counts behind the success of a study's policies: starts of each evaluation, and policies.

A policy is one observation. Its success is a share of the distinct starts of an evaluation, and
intervals are over policies.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from gril_jax.report.rates import SURE, UNKNOWN, Rate

from .written import Line, column

COUNTS = ("starts", "episodes")  # in a policy's line, both of an evaluation


class Counted(NamedTuple):
    """Episodes of one kind of actions in an evaluation, and how many of their starts differ."""

    episodes: int
    distinct: int

    def in_words(self, variant: str = "", *, sampled: bool = False) -> str:
        """Such as "256 Jitter starts"."""
        return Rate(0.0, self.distinct, self.episodes, sampled, variant).counted


def read(done: Mapping[str, Any]) -> dict[str, Counted]:
    """The starts that a finished program of policies has noted, by variant; empty if none."""
    return {variant: Counted(**found) for variant, found in done.get("starts", {}).items()}


def in_words(starts: Mapping[str, Counted], variant: str, *, sampled: bool = False) -> str:
    """The starts that an evaluation from a variant counts, as far as they are recorded."""
    found = starts.get(variant)
    return UNKNOWN if found is None else found.in_words(variant, sampled=sampled)


def solved(values: Float[np.ndarray, "K"], count: int) -> str:
    """The number of policies that solve a single start, mean actions: `solved by 4 of 5`."""
    del count
    return f"solved by {int((values >= SURE).sum())} of {len(values)} policies"


def of_lines(lines: Sequence[Line], variant: str = "", *, sampled: bool = False) -> str:
    """The starts that success counts in these lines, in words, by their fields `starts` and
    `episodes`, from a variant of the task if that is known."""
    known = [line for line in lines if np.isfinite(line.get("success", np.nan))]
    starts, episodes = (column(known, name) for name in COUNTS)
    if not len(known) or np.isnan(starts).any():
        return UNKNOWN
    if starts.min() < starts.max():
        return f"{starts.min():.0f} to " + Rate(0.0, int(starts.max()), variant=variant).counted
    played = 0 if np.isnan(episodes).any() else int(episodes.max())
    return Counted(played, int(starts[0])).in_words(variant, sampled=sampled)
