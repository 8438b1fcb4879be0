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

    Found ends are increasing frames of each, filled up with -1; the true ones have names, and are
    -1 for never. A found one may miss a true one by `tolerance` frames.

    Returns:
      all_found: share of the demonstrations whose stages are all met.
      precision, recall: shares of the found and of the true ends that are met, of all together.
      median_error: median distance of those that are met, frames; NaN if there is none.
      errors: for each stage the median of found minus true, frames; None if never met.
      false: found ends that meet none, a demonstration.
      right_count: share of the demonstrations with as many ends as stages.
    """
    met, counts, truths = [], [], []
    errors: dict[str, list[int]] = {name: [] for name in stages[0]}
    for ends, times in zip(found, stages, strict=True):
        ends = ends[ends >= 0]
        order = sorted((time, name) for name, time in times.items() if time >= 0)
        true = jnp.array([time for time, _ in order], jnp.int32)
        # As many pairs as possible, and among those the nearest.
        column = np.asarray(_match(jnp.asarray(ends), true, tolerance=tolerance))
        for i in np.flatnonzero(column >= 0):
            time, name = order[column[i]]
            errors[name].append(int(ends[i]) - time)
        met.append((column >= 0).sum()), counts.append(len(ends)), truths.append(len(order))
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


_match = jax.jit(match_within, static_argnames="tolerance")
