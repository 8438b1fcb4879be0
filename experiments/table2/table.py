"""Table II as Markdown and CSV: one line a row of the table, and one line an encoder.

A line is a mapping from columns to values; `row` and `seed` say which encoder it is.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.experiments.sweeps import table_csv

from gril_jax.metrics.interquartile import interquartile_interval

from .measures import MEASURES
from .rows import PAPER

__all__ = ["Line", "csv", "kinds", "markdown", "spread"]

Line = Mapping[str, Any]

_LEGEND = """\
Mean over seeds (95 % bootstrap interval of the interquartile mean). rho (Eq. 8) is the mean
|cumulative reward| of held-out successes over that of failures, lower is better. A sum depends on
how long a recording is, and failures are often short. held: what a recording ends with goes on
to the length of the longest, as in an episode of fixed length; resampled: each is stretched to
that length; natural: as it is. The paper does not say which is its own. AUC: how often a success
is above a failure, by the reward of its last frame or by its sum. Order of stages: Somers' D of
the reward with the number of stages done, held-out successes; tau: Kendall's tau of nearest
neighbours."""


def kinds(lines: Sequence[Line]) -> list[str]:
    """Kinds of failure, in the order in which they are met."""
    return list(dict.fromkeys(k[4:] for line in lines for k in line if k.startswith("auc ")))


def csv(lines: Sequence[Line]) -> str:
    """One line an encoder; what is not finite is empty."""
    each = [f"{what} {kind}" for kind in kinds(lines) for what in ("auc", "last")]
    return table_csv.written(lines, ["row", "seed", *MEASURES, "tau", "last success", *each])


def markdown(lines: Sequence[Line]) -> str:
    """All measures with the paper's ratio, and the kinds of failure, as two tables."""
    names = list(dict.fromkeys(line["row"] for line in lines))
    of = {name: [line for line in lines if line["row"] == name] for name in names}
    heads = {"paper's rho": {n: f"{PAPER[n]:.3f}" if n in PAPER else "" for n in names}}
    for column, head in {**MEASURES, "tau": "tau"}.items():
        heads[head] = {n: spread([line.get(column) for line in of[n]]) for n in names}
    failures = {
        kind: {n: spread([line.get(f"auc {kind}") for line in of[n]], digits=2) for n in names}
        for kind in kinds(lines)
    }
    seeds = max(len(members) for members in of.values())
    parts = [f"Seeds: {seeds}", "", *_table(heads), "", _LEGEND.replace("\n", " ")]
    if failures:
        words = "AUC of the last reward, successes against failures of each kind:"
        parts += ["", words, "", *_table(failures)]
    return "\n".join(parts)


def spread(values: Sequence[float | None], *, digits: int = 3) -> str:
    """Mean and interval of what is known; nothing of nothing."""
    known = np.array([_number(value) for value in values], np.float32)
    known = known[np.isfinite(known)]
    if not len(known):
        return ""
    mean = f"{known.mean():.{digits}f}"
    if len(known) == 1:
        return mean
    low, high = _interval(jax.random.key(0), jnp.asarray(known))
    return f"{mean} ({float(low):.{digits}f} to {float(high):.{digits}f})"


_interval = jax.jit(interquartile_interval)


def _number(value: float | None) -> float:
    """What was not finite is null in a run's files."""
    return float("nan") if value is None else float(value)


def _table(columns: Mapping[str, Mapping[str, str]]) -> list[str]:
    rows = list(next(iter(columns.values())))
    return [
        "| | " + " | ".join(columns) + " |",
        "|---" * (len(columns) + 1) + "|",
        *(f"| {row} | " + " | ".join(c[row] for c in columns.values()) + " |" for row in rows),
    ]
