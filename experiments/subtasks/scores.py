"""Scores of found stage ends against the true ones, over many demonstrations."""

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Int

from gril_jax.subtasks.matching import match_within


def scores(
    found: Sequence[Int[np.ndarray, "M"]], stages: Sequence[Mapping[str, int]], tolerance: int
) -> dict[str, Any]:
    """Scores of several demonstrations together.

    Args:
      found: frames of each, increasing, filled up with -1.
      stages: the true ones by their names, -1 for never; at least one demonstration.
      tolerance: frames by which a found end may miss a true one.

    Returns:
      all_found: share of the demonstrations whose stages are all met.
      precision, recall: shares of the found and of the true ends that are met, of all together.
      median_error: median distance of those that are met, frames; NaN if there is none.
      errors: for each stage the median of found minus true, frames; None if never met.
      false: found ends that meet none, a demonstration.
      right_count: share of the demonstrations with as many ends as stages.
      demonstrations: how many there are.
    """
    met, counts, truths = [], [], []
    errors: dict[str, list[int]] = {name: [] for name in stages[0]}
    for ends, times in zip(found, stages, strict=True):
        ends = ends[ends >= 0]
        order = sorted((time, name) for name, time in times.items() if time >= 0)
        pairs = _matched(ends, np.array([time for time, _ in order], np.int32), tolerance)
        for i, j in pairs:
            errors[order[j][1]].append(int(ends[i]) - order[j][0])
        met.append(len(pairs)), counts.append(len(ends)), truths.append(len(order))
    met, counts, truths = np.array(met), np.array(counts), np.array(truths)
    every = np.abs(np.array([e for one in errors.values() for e in one], float))
    return {
        "all_found": float(np.mean(met == truths)),
        "precision": float(met.sum() / max(counts.sum(), 1)),
        "recall": float(met.sum() / max(truths.sum(), 1)),
        "median_error": float(np.median(every)) if len(every) else float("nan"),
        "errors": {k: float(np.median(v)) if v else None for k, v in errors.items()},
        "false": float(np.mean(counts - met)),
        "right_count": float(np.mean(counts == truths)),
        "demonstrations": len(found),
    }


def _matched(found, true, tolerance: int) -> list[tuple[int, int]]:
    """Pairs of indices, in order: as many as possible, and among those the nearest."""
    column = np.asarray(_match(jnp.asarray(found), jnp.asarray(true), tolerance=tolerance))
    return [(i, int(j)) for i, j in enumerate(column) if j >= 0]


_match = jax.jit(match_within, static_argnames="tolerance")
