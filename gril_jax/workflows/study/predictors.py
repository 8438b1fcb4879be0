"""Correlations of the measures of learned rewards with the success of the policies they train.

    found = correlations(lines, success="success_jitter")

A policy is one observation: a measure of its reward, and its success. Their correlation is
Spearman's, turned where a lower measure is better, so that 1 always means that the better reward
trains the better policy.

Shapes use P for policies and R for resamples of them.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from scipy.stats import rankdata

from gril_jax.report.style import COLOURS, GREY, WIDTH, styled

from .results import Found, Line
from .table import Part

_LEAST = 10  # policies: of fewer a correlation says nothing
_RESAMPLES = 2000
_ROW = 0.27  # inches: a measure in the figure
# What a measure's name begins with, and what it is called. Those of an audit end with a variant.
_MEASURES = {
    "tau": "alignment tau",
    "reward_time_tau": "tau of reward and time",
    "reward_time_tau_tails": "tau of reward and time, with resting ends",
    "voc_pearson": "VOC, Pearson",
    "voc_spearman": "VOC, Spearman",
    "auc_final": "AUC, last reward",
    "policy_ranking": "policy ranking",
    "preference_accuracy": "preferences in order",
    "order_": "order",
    "hack_gap_": "hack gap",
    "kept_": "success kept",
    "misranked_": "misranked",
    "touch_": "touch",
    "push_": "push",
}
_LOWER_IS_BETTER = ("misranked_", "touch_", "push_")


class Correlation(NamedTuple):
    """Spearman's correlation of a measure with success, and its 95 % bootstrap interval."""

    measure: str
    value: float
    low: float
    high: float
    policies: int


def correlations(lines: Sequence[Line], *, success: str) -> list[Correlation]:
    """Of each measure that ten policies or more have, the highest first.

    Args:
      success: the name of the policies' success in the lines.

    Returns:
      Nothing of a measure, or of success, that is the same for all policies.
    """
    found = []
    for name, (said, sign) in _named(lines).items():
        both = [(line.get(name), line.get(success)) for line in lines]
        numbers = [pair for pair in both if all(isinstance(x, int | float) for x in pair)]
        values = np.array(numbers, float).reshape(-1, 2)
        values = values[np.isfinite(values).all(axis=1)] * [sign, 1.0]
        if len(values) < _LEAST or (values == values[0]).all(axis=0).any():
            continue
        low, high = _interval(values)
        found.append(Correlation(said, _spearman(values.T[None]).item(), low, high, len(values)))
    return sorted(found, key=lambda one: -one.value)


def of(found: Found) -> list[Correlation]:
    """The correlations of a study's rewards with the success that its table begins with."""
    suffix = next(iter(found.starts.values()))
    return correlations(found.lines, success=f"success{suffix}")


def part(known: Sequence[Correlation]) -> Part:
    """Correlations as a section of a study's table."""
    caption = (
        "Spearman's correlation of a reward's measures with the success of its policy (95 % "
        "bootstrap interval), each policy one observation. Where lower is better, the sign is "
        "turned: 1 if the better reward always trains the better policy."
    )
    cells = {x.measure: [f"{x.value:.2f} ({x.low:.2f} to {x.high:.2f})", str(x.policies)]
             for x in known}  # fmt: skip
    return Part(caption, ["correlation with success", "policies"], cells)


@styled
def figure(known: Sequence[Correlation]) -> Figure:
    """A dot for each correlation, on a line over its interval."""
    height = _ROW * len(known) + 0.75
    drawn = Figure(figsize=(WIDTH, height))
    axes = drawn.add_axes((0.36, 0.55 / height, 0.62, _ROW * len(known) / height))
    axes.axvline(0.0, color=GREY, linewidth=0.8, linestyle=":")
    for at, one in enumerate(known):
        axes.plot([one.low, one.high], [at, at], color=COLOURS[0], alpha=0.55, linewidth=2.2)
        axes.plot(one.value, at, "o", color=COLOURS[1], markersize=5)
    axes.set_yticks(range(len(known)), [one.measure for one in known])
    axes.set_ylim(len(known) - 0.5, -0.5)
    axes.set_xlim(-1.03, 1.03)
    axes.set_xlabel("rank correlation with the policies' success")
    return drawn


def _named(lines: Sequence[Line]) -> dict[str, tuple[str, float]]:
    """Of each measure that the lines have, its name, what it is called, and its sign."""
    names = dict.fromkeys(name for line in lines for name in line)
    found = {}
    for start, said in _MEASURES.items():
        sign = -1.0 if start in _LOWER_IS_BETTER else 1.0
        for name in names:
            end = name.removeprefix(start)
            if name == start:
                found[name] = said, sign
            elif start.endswith("_") and name.startswith(start) and "_" not in end:
                found[name] = f"{said}, {end}", sign
    return found


def _spearman(values: Float[np.ndarray, "R 2 P"]) -> Float[np.ndarray, "R"]:
    """Pearson's correlation of ranks; NaN where one of the two is constant."""
    ranks = rankdata(values, axis=-1)
    ranks = ranks - ranks.mean(axis=-1, keepdims=True)
    spread = np.sqrt((ranks**2).sum(axis=-1).prod(axis=-1))
    with np.errstate(invalid="ignore"):
        return ranks.prod(axis=-2).sum(axis=-1) / spread


def _interval(values: Float[np.ndarray, "P 2"]) -> tuple[float, float]:
    """The 95 % percentile interval over resamples of the policies."""
    count = len(values)
    which = np.random.default_rng(0).integers(0, count, (_RESAMPLES, count))
    each = _spearman(np.swapaxes(values[which], 1, 2))
    low, high = np.nanquantile(each, [0.025, 0.975])
    return float(low), float(high)
