"""Choices of encoder training that make a reward sound, and how well an audit foretells success.

    gril soundness match_regions --seeds 5 --out RUN
    gril soundness --join RUN,RUN --out FOLDER       tables of runs with different rows as one

For each row and seed an encoder is trained, audited from Demo and from Layout starts, and a policy
is trained with its reward. Writes `soundness.csv` (a line an encoder), `soundness.md` (a line a
row, and Spearman's correlation of each figure with success, with a percentile bootstrap over
encoders: Efron & Tibshirani, 1993, section 13.3) and `soundness.png`. Shapes use n for encoders.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from scipy.stats import rankdata

from gril_jax.errors import ShapeError
from gril_jax.report.figures.style import COLOURS, WIDTH, shortened, styled
from gril_jax.workflows.study.counted import of_lines, success_columns
from gril_jax.workflows.study.curves import LAST
from gril_jax.workflows.study.measures import FIGURES, TAU, VARIANTS, audit, audited_tasks
from gril_jax.workflows.study.results import Found, Table
from gril_jax.workflows.study.written import SEEDS, Column, Line, Section, column, markdown

from .rows import Settings

AUDIT = [f"{name}_{variant}" for variant in VARIANTS for name in FIGURES]
COLUMNS = ("row", "seed", "tau", *AUDIT, *LAST)

# Figures that should foretell success: by a high value (1) or by a low one (-1).
_SIGNS = {
    "order": 1, "touch": -1, "push": -1, "hack_gap": 1, "hack_share": -1, "hack_gap_anywhere": 1,
    "outbid": -1,
}  # fmt: skip
PREDICTORS = {"tau": 1} | {name: _SIGNS[name.rpartition("_")[0]] for name in AUDIT}

_ENOUGH = 20  # encoders for a correlation that is worth telling

_OF_AUDITS = [
    Section(
        f"{variant.capitalize()} starts:",
        [
            Column(f"{name}_{variant}", name.replace("_", " "))
            for name in ("order", "touch", "push", "hack_gap", "outbid")
        ],
    )
    for variant in VARIANTS
]


def sections(found: Found) -> list[Section]:
    """The sections of the table, of which the first is of tau and success."""
    caption = (
        "Mean over encoders; of tau the lowest and highest, of success the interquartile mean and "
        "its 95 % bootstrap interval. Each encoder has one policy, which is one observation: its "
        "success at the end of its last evaluation's episodes."
    )
    encoders = SEEDS._replace(heading="encoders")
    first = Section(
        caption, (encoders, Column("tau", "tau"), *success_columns(found.lines, found.variant))
    )
    return [first, *_OF_AUDITS]


_LEGEND = (
    "Order: share of pairs of made-up states that are paid in the order of their true progress. "
    "Hack gap: what the worst success, of those well inside, is paid more than the best state "
    "without progress. Touch, push: what the best touch or wrong push is paid more than the start, "
    "as a share of what success is; undefined where that is nothing. Outbid: the share of all that "
    "the task counts as a success which is paid no more than the best state without progress. The "
    "hack share, of that state, and the gap over all successes are in the CSV."
)
_PREDICTIONS = (
    Column("ought", "should be"),
    Column("rho", "correlation"),
    Column("better", "better than tau"),
)


class Correlation(NamedTuple):
    """Correlation of one figure with success; NaN where either is the same for all encoders."""

    rho: float
    low: float  # of the 95 % interval
    high: float
    better: float  # share of bootstrap samples in which the figure predicts better than its rival
    count: int  # encoders with a success


def spearman(
    x: Float[np.ndarray, "*rows n"], y: Float[np.ndarray, "*rows n"]
) -> Float[np.ndarray, "*rows"]:
    """Spearman's rank correlation along the last axis, ties at their mean rank; NaN if constant."""
    x, y = (rankdata(values, axis=-1) for values in (x, y))
    x, y = (ranks - ranks.mean(axis=-1, keepdims=True) for ranks in (x, y))
    scale = np.sqrt((x**2).sum(axis=-1) * (y**2).sum(axis=-1))
    varied = scale > 0
    return np.where(varied, (x * y).sum(axis=-1) / np.where(varied, scale, 1.0), np.nan)


def correlation(
    figure: Float[np.ndarray, "n"],
    success: Float[np.ndarray, "n"],
    rival: Float[np.ndarray, "n"],
    *,
    sign: int = 1,
    draws: int = 4000,
) -> Correlation:
    """A figure's correlation with success, beside that of a rival that should be positive.

    A figure that is undefined, as a share is where success is paid no more than the start,
    ranks as the worst; an encoder without a policy is left out. The sign is 1 where a high
    figure should mean success, and -1 where a low one should.
    """
    figure = np.where(np.isnan(figure), -sign * np.inf, figure)
    known = np.isfinite(success) & np.isfinite(rival)
    figure, success, rival = (np.asarray(x, np.float64)[known] for x in (figure, success, rival))
    count = int(known.sum())
    unknown = Correlation(np.nan, np.nan, np.nan, np.nan, count)
    if count < 2:
        return unknown
    rho = float(spearman(figure, success))
    chosen = np.random.default_rng(0).integers(count, size=(draws, count))
    samples = spearman(figure[chosen], success[chosen])
    other = spearman(rival[chosen], success[chosen])
    usual = np.isfinite(samples)  # a sample may have the same encoder throughout
    both = usual & np.isfinite(other)
    if not usual.any():
        return unknown
    low, high = np.quantile(samples[usual], [0.025, 0.975])
    better = float((sign * samples > other)[both].mean()) if both.any() else np.nan
    return Correlation(rho, float(low), float(high), better, count)


def text(found: Found) -> str:
    """Mean and range of each row, then how well each figure foretells success."""
    parts = [markdown(found.lines, sections(found)), _LEGEND, *_predictions(found)]
    return "\n\n".join(parts)


def _predictions(table: Found) -> list[str]:
    """Lines on how well each figure predicts success; empty without policies."""
    lines = table.lines
    success, tau = column(lines, "success"), column(lines, "tau")
    known = success[np.isfinite(success)]
    if not len(known):
        return []
    found = {
        name: correlation(column(lines, name), success, tau, sign=sign)
        for name, sign in PREDICTORS.items()
    }
    caption = (
        f"Spearman's correlation with success over {len(known)} encoders, its 95 % bootstrap "
        "interval, and the share of bootstrap samples in which a figure predicts success better "
        "than tau does:"
    )
    rows = [
        {
            "row": _in_words(name),
            "ought": "positive" if PREDICTORS[name] > 0 else "negative",
            "rho": "" if np.isnan(one.rho) else f"{one.rho:.2f} ({one.low:.2f} to {one.high:.2f})",
            "better": "" if name == "tau" or np.isnan(one.better) else f"{100 * one.better:.0f} %",
        }
        for name, one in found.items()
    ]
    return [
        markdown(rows, [Section(caption, _PREDICTIONS)]),
        _verdict(known, found, of_lines(lines, table.variant)),
    ]


def _verdict(
    success: Float[np.ndarray, "n"], found: Mapping[str, Correlation], counted: str
) -> str:
    """The best figure in a sentence, and the data behind its correlation."""
    few, most = int((success < 0.05).sum()), int((success > 0.95).sum())
    few_seen = f"; {_ENOUGH} encoders at least would be needed." * (len(success) < _ENOUGH)
    basis = (
        f"{few} of {len(success)} encoders gave a success below 5 %, and {most} above 95 % "
        f"({counted}){few_seen or '.'}"
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


_PANELS = {
    "tau": "Kendall's tau on held-out videos",
    "order_demo": "order accuracy, Demo starts",
    "touch_demo": "what a touch is paid, Demo starts",
    "hack_gap_demo": "hack gap, Demo starts",
}
# With deterministic actions a policy is right or wrong, and dots hide each other.
_SUCCESS = "success_sampled"
_MARKERS = "os^Dv"


@styled
def figure(lines: Sequence[Line]) -> Figure:
    """Success against figures known before a policy is; each encoder is a dot in each panel.

    Raises ShapeError if no encoder has a policy.
    """
    lines = [line for line in lines if np.isfinite(line.get(_SUCCESS, np.nan))]
    if not lines:
        raise ShapeError("lines has no success; at least one encoder must have a policy.")
    names = list(dict.fromkeys(line["row"] for line in lines))
    drawn = Figure(figsize=(WIDTH, 0.75 * WIDTH + 0.11 * len(names)))
    panels = drawn.subplots(2, 2, sharey=True)
    for axes, (name, label) in zip(panels.flat, _PANELS.items(), strict=True):
        for number, row in enumerate(names):
            members = [line for line in lines if line["row"] == row]
            axes.plot(
                column(members, name), column(members, _SUCCESS),
                color=COLOURS[number % len(COLOURS)],
                marker=_MARKERS[number // len(COLOURS) % len(_MARKERS)],
                linestyle="none", markersize=5.5, alpha=0.75, label=shortened(row),
            )  # fmt: skip
        axes.set_xlabel(label)
        axes.locator_params(axis="x", nbins=5)
    for axes in panels[:, 0]:
        axes.set(ylabel="success, sampled actions", ylim=(-0.04, 1.04))
    drawn.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    drawn.set_layout_engine("constrained")
    return drawn


def _plan(rows, settings: Settings, programs):
    audited_tasks(rows[0].config.env)  # refuses what cannot be audited
    return programs(rows, at_once=settings.policies_at_once) if settings.policies else []


def _measures(config, settings: Settings, demos):
    tasks = audited_tasks(config.env)
    return [TAU, audit(tasks, starts=settings.starts, ascents=settings.ascents)]


def _drawn(found: Found):
    return figure(found.lines) if any("success" in line for line in found.lines) else None


TABLE = Table(
    "soundness",
    columns=lambda lines: COLUMNS,
    text=text,
    figure=_drawn,
    settings=Settings,
    plan=_plan,
    measured={"tau": ("tau",), "audit": AUDIT},
    measures=_measures,
    newer=[name for name in AUDIT if name.startswith(("hack_gap_anywhere", "outbid"))],
    joins_csv=True,
)
