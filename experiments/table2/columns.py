"""The columns of Table II: measures beside the paper's ratio, and the kinds of failure."""

from collections.abc import Sequence

from ..tables.results import Found
from ..tables.written import (
    Column,
    Line,
    Section,
    markdown,
    mean_interval,
    with_paper,
)
from .rows import PAPER

# Measures of an encoder; the separation ratio first in the convention that is compared with the
# paper's.
MEASURES = (
    "rho_held", "rho_resampled", "rho_natural", "auc_final", "auc_held", "auc_resampled", "order",
)  # fmt: skip

_shares = mean_interval(middle=False)

_SECTIONS = (
    Section(
        "Mean over seeds (95 % bootstrap interval of the interquartile mean). rho (Eq. 8) is the "
        "mean |cumulative reward| of held-out successes over that of failures, lower is better. A "
        "sum depends on how long a recording is, and failures are often short. held: what a "
        "recording ends with goes on to the length of the longest, as in an episode of fixed "
        "length; resampled: each is stretched to that length; natural: as it is. The paper does "
        "not say which is its own.",
        (
            Column("paper", "paper's rho"),
            Column("rho_held", "rho, held", _shares),
            Column("rho_resampled", "rho, resampled", _shares),
            Column("rho_natural", "rho, natural", _shares),
        ),
    ),
    Section(
        "AUC: how often a success is above a failure, by the reward of its last frame or by its "
        "held sum (that of the resampled sum is in the CSV). Order of stages: Somers' D of the "
        "reward with the number of stages done, held-out successes; tau: Kendall's tau of nearest "
        "neighbours.",
        (
            Column("auc_final", "AUC, last reward", _shares),
            Column("auc_held", "AUC, held sum", _shares),
            Column("order", "order of stages", _shares),
            Column("tau", "tau", _shares),
        ),
    ),
)


def kinds(lines: Sequence[Line]) -> list[str]:
    """Kinds of failure, in order of appearance."""
    return list(dict.fromkeys(k[4:] for line in lines for k in line if k.startswith("auc ")))


def columns(lines: Sequence[Line]) -> list[str]:
    """The columns of the CSV: those of each kind of failure come last."""
    each = [f"{what} {kind}" for kind in kinds(lines) for what in ("auc", "last")]
    return ["row", "seed", *MEASURES, "tau", "last success", *each]


def text(found: Found) -> str:
    """All measures with the paper's ratio, and the kinds of failure, as Markdown."""
    lines, write = with_paper(found.lines, PAPER, 3), mean_interval(digits=2, middle=False)
    failures = Section(
        "AUC of the last reward, successes against failures of each kind:",
        [Column(f"auc {kind}", kind, write) for kind in kinds(lines)],
    )
    rows = [line["row"] for line in lines]
    seeds = max(rows.count(row) for row in rows)
    return f"Seeds: {seeds}\n\n{markdown(lines, [*_SECTIONS, failures])}"
