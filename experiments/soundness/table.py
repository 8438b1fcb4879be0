"""An ablation of soundness as tables: one line an encoder, one a row, one a figure.

A line is a mapping from columns to values; `row` and `seed` say which encoder it is, the others are
numbers, and a column that is not known yet is missing.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from .audit import FIGURES, VARIANTS
from .correlation import Correlation, correlation

__all__ = ["COLUMNS", "PREDICTORS", "SCORES", "column", "markdown"]

Line = Mapping[str, Any]

SCORES = ("env_steps", "success", "success_sampled", "success_ever", "score")
_AUDIT = [f"{name}_{variant}" for variant in VARIANTS for name in FIGURES]
COLUMNS = ("row", "seed", "tau", *_AUDIT, *SCORES)

# What should tell success beforehand, and whether by a high value (1) or by a low one (-1).
_SIGNS = {"order": 1, "touch": -1, "push": -1, "hack_gap": 1, "hack_share": -1}
PREDICTORS = {"tau": 1} | {name: _SIGNS[name.rpartition("_")[0]] for name in _AUDIT}

_LEGEND = (
    "Mean over encoders (lowest to highest). Order: share of pairs of made-up states that are paid "
    "in the order of their true progress. Hack gap: what the worst success is paid more than the "
    "best state without progress. Touch, push, hack share: what the best touch, wrong push or such "
    "state is paid more than the start, as a share of what success is; undefined where "
    "that is nothing. Success is counted at the end of the episode."
)

_ENOUGH = 20  # encoders for a correlation that is worth telling


def column(lines: Sequence[Line], name: str) -> Float[np.ndarray, "n"]:
    """One number of each line; NaN where it is not known."""
    return np.array([line.get(name, np.nan) for line in lines], np.float64)


def markdown(lines: Sequence[Line]) -> str:
    """Mean and range of each row, then how well each figure predicts success."""
    parts = []
    for variant in VARIANTS:
        heads = {"tau": "tau"} if variant == VARIANTS[0] else {}
        heads |= {f"{name}_{variant}": name.replace("_", " ") for name in FIGURES}
        if variant == VARIANTS[0] and np.isfinite(column(lines, "success")).any():
            heads |= {"success": "success", "success_sampled": "success, actions drawn"}
        parts += [f"{variant.capitalize()} starts:", "", *_rows(lines, heads), ""]
    parts.append(_LEGEND)
    return "\n".join([*parts, *_predictions(lines)])


def _rows(lines: Sequence[Line], heads: Mapping[str, str]) -> list[str]:
    table = ["| | encoders | " + " | ".join(heads.values()) + " |", "|---" * (len(heads) + 2) + "|"]
    for name in dict.fromkeys(line["row"] for line in lines):
        members = [line for line in lines if line["row"] == name]
        cells = [_spread(column(members, head)) for head in heads]
        table.append(f"| {name} | {len(members)} | " + " | ".join(cells) + " |")
    return table


def _spread(values: Float[np.ndarray, "n"]) -> str:
    known = values[np.isfinite(values)]
    if not len(known):
        return "-"
    lacking = f"; {len(values) - len(known)} undefined" if len(known) < len(values) else ""
    return f"{known.mean():.3f} ({known.min():.3f} to {known.max():.3f}{lacking})"


def _predictions(lines: Sequence[Line]) -> list[str]:
    """Nothing where there are no policies."""
    success, tau = column(lines, "success"), column(lines, "tau")
    known = success[np.isfinite(success)]
    if not len(known):
        return []
    found = {
        name: correlation(column(lines, name), success, tau, sign=sign)
        for name, sign in PREDICTORS.items()
    }
    table = [
        "",
        f"Spearman's correlation with success over {len(known)} encoders, its 95 % bootstrap "
        "interval, and the share of bootstrap samples in which a figure predicts success better "
        "than tau does:",
        "",
        "| figure | should be | correlation | better than tau |",
        "|---|---|---|---|",
    ]
    for name, one in found.items():
        ought = "positive" if PREDICTORS[name] > 0 else "negative"
        share = "" if name == "tau" or np.isnan(one.better) else f"{100 * one.better:.0f} %"
        cell = "" if np.isnan(one.rho) else f"{one.rho:.2f} ({one.low:.2f} to {one.high:.2f})"
        table.append(f"| {_in_words(name)} | {ought} | {cell} | {share} |")
    return [*table, "", _verdict(known, found)]


def _verdict(success: Float[np.ndarray, "n"], found: Mapping[str, Correlation]) -> str:
    """The best figure in a sentence, and what its correlation rests on."""
    few, most = int((success < 0.05).sum()), int((success > 0.95).sum())
    basis = f"{few} of {len(success)} encoders gave a success below 5 %, and {most} above 95 %" + (
        f"; {_ENOUGH} encoders at least would be needed." if len(success) < _ENOUGH else "."
    )
    signed = {n: PREDICTORS[n] * one.rho for n, one in found.items() if np.isfinite(one.rho)}
    if not signed:
        return f"All encoders are the same in success, so nothing predicts it: {basis}"
    best = max(signed, key=lambda name: signed[name])
    if best == "tau":
        return f"No figure of the audit predicts success better than tau does: {basis}"
    better = found[best].better  # not known where tau is the same for all
    than = "" if np.isnan(better) else f", better than tau in {100 * better:.0f} % of the samples"
    return f"The best is {_in_words(best)}{than}: {basis}"


def _in_words(name: str) -> str:
    words, _, variant = name.rpartition("_")
    return f"{words.replace('_', ' ')}, {variant.capitalize()} starts" if words else name
