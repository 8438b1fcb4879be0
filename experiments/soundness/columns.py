"""The columns of an ablation of soundness, and how well each figure foretells success."""

from collections.abc import Mapping, Sequence

import numpy as np
from gril_jax.experiments.tables.audits import FIGURES, VARIANTS
from gril_jax.experiments.tables.curves import LAST
from gril_jax.experiments.tables.table import Found
from gril_jax.experiments.tables.written import SEEDS, Column, Line, Section, column, markdown, same
from jaxtyping import Float

from .correlation import Correlation, correlation

AUDIT = [f"{name}_{variant}" for variant in VARIANTS for name in FIGURES]
COLUMNS = ("row", "seed", "tau", *AUDIT, *LAST)

# Figures that should foretell success: by a high value (1) or by a low one (-1).
_SIGNS = {"order": 1, "touch": -1, "push": -1, "hack_gap": 1, "hack_share": -1}
PREDICTORS = {"tau": 1} | {name: _SIGNS[name.rpartition("_")[0]] for name in AUDIT}

_ENOUGH = 20  # encoders for a correlation that is worth telling

SECTIONS = (
    Section(
        "Mean over encoders (lowest to highest). Success is counted at the end of the episode.",
        (
            SEEDS._replace(heading="encoders"),
            Column("tau", "tau"),
            Column("success", "success, deterministic actions"),
            Column("success_sampled", "success, sampled actions"),
        ),
    ),
    *(
        Section(
            f"{variant.capitalize()} starts:",
            [
                Column(f"{name}_{variant}", name.replace("_", " "))
                for name in ("order", "touch", "push", "hack_gap")
            ],
        )
        for variant in VARIANTS
    ),
)

_LEGEND = (
    "Order: share of pairs of made-up states that are paid in the order of their true progress. "
    "Hack gap: what the worst success is paid more than the best state without progress. Touch, "
    "push: what the best touch or wrong push is paid more than the start, as a share of what "
    "success is; undefined where that is nothing. The hack share, the same of the best state "
    "without progress, is in the CSV."
)


def text(found: Found) -> str:
    """Mean and range of each row, then how well each figure foretells success."""
    parts = [markdown(found.lines, SECTIONS), _LEGEND, *_predictions(found.lines)]
    return "\n\n".join(parts)


def _predictions(lines: Sequence[Line]) -> list[str]:
    """Lines on how well each figure predicts success; empty without policies."""
    success, tau = column(lines, "success"), column(lines, "tau")
    known = success[np.isfinite(success)]
    if not len(known):
        return []
    found = {
        name: correlation(column(lines, name), success, tau, sign=sign)
        for name, sign in PREDICTORS.items()
    }
    section = Section(
        f"Spearman's correlation with success over {len(known)} encoders, its 95 % bootstrap "
        "interval, and the share of bootstrap samples in which a figure predicts success better "
        "than tau does:",
        [
            Column("ought", "should be", same),
            Column("rho", "correlation", same),
            Column("better", "better than tau", same),
        ],
    )
    lines = [
        {
            "row": _in_words(name),
            "ought": "positive" if PREDICTORS[name] > 0 else "negative",
            "rho": "" if np.isnan(one.rho) else f"{one.rho:.2f} ({one.low:.2f} to {one.high:.2f})",
            "better": "" if name == "tau" or np.isnan(one.better) else f"{100 * one.better:.0f} %",
        }
        for name, one in found.items()
    ]
    return [markdown(lines, [section]), _verdict(known, found)]


def _verdict(success: Float[np.ndarray, "n"], found: Mapping[str, Correlation]) -> str:
    """The best figure in a sentence, and the data behind its correlation."""
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
