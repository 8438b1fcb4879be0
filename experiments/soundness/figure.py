"""The figure of an ablation of soundness: success against figures known before a policy is.

Success is that with sampled actions: with deterministic ones a policy is right or wrong, and dots
hide each other.
"""

from collections.abc import Sequence

import numpy as np
from gril_jax.experiments.tables.written import Line, column
from matplotlib.figure import Figure

from gril_jax.errors import ShapeError
from gril_jax.report.figures.style import COLOURS, WIDTH, shortened, styled

_PANELS = {
    "tau": "Kendall's tau on held-out videos",
    "order_demo": "order accuracy, Demo starts",
    "touch_demo": "what a touch is paid, Demo starts",
    "hack_gap_demo": "hack gap, Demo starts",
}
_SUCCESS = "success_sampled"
_MARKERS = "os^Dv"


@styled
def figure(lines: Sequence[Line]) -> Figure:
    """A panel for each figure, a dot for each encoder, and a colour or marker for each row.

    Raises:
      ShapeError: no encoder has a policy.
    """
    lines = [line for line in lines if np.isfinite(line.get(_SUCCESS, np.nan))]
    if not lines:
        raise ShapeError("lines has no success; at least one encoder must have a policy.")
    names = list(dict.fromkeys(line["row"] for line in lines))
    height = 0.75 * WIDTH + 0.11 * len(names)
    drawn = Figure(figsize=(WIDTH, height))
    panels = drawn.subplots(2, 2, sharey=True)
    for axes, (name, label) in zip(panels.flat, _PANELS.items(), strict=True):
        for number, row in enumerate(names):
            members = [line for line in lines if line["row"] == row]
            look = {
                "color": COLOURS[number % len(COLOURS)],
                "marker": _MARKERS[number // len(COLOURS) % len(_MARKERS)],
            }
            axes.plot(
                column(members, name), column(members, _SUCCESS),
                linestyle="none", markersize=5.5, alpha=0.75, label=shortened(row), **look,
            )  # fmt: skip
        axes.set_xlabel(label)
        axes.locator_params(axis="x", nbins=5)
    for axes in panels[:, 0]:
        axes.set_ylabel("success, sampled actions")
        axes.set_ylim(-0.04, 1.04)
    drawn.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    drawn.set_layout_engine("constrained")
    return drawn
