"""A sweep's figure: success while policies are trained, one line a cell with its seeds' spread."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from .plot_style import COLOURS, WIDTH, png, shortened, styled
from .sweep_table import Result

__all__ = ["figure", "write_figure"]


@styled
def figure(names: Sequence[str], found: Sequence[Result]) -> Figure:
    """The mean over seeds, and from the lowest to the highest quarter of them, of each cell.

    Beyond as many cells as there are colours, line styles tell them apart.
    """
    drawn = Figure(figsize=(WIDTH, 0.5 * WIDTH + 0.16 * len(names)))
    axes = drawn.add_subplot()
    for cell, name in enumerate(names):
        members = [result for result in found if result.cell == cell]
        if not members:
            continue
        steps = np.concatenate([[0], members[0].env_steps]) / 1e6
        curves = np.stack([r.scores["success_sampled"] for r in members])
        curves = np.concatenate([np.zeros((len(members), 1)), curves], axis=1)
        colour = COLOURS[cell % len(COLOURS)]
        style = ("-", "--", ":", "-.")[cell // len(COLOURS) % 4]
        low, high = np.quantile(curves, [0.25, 0.75], axis=0)
        axes.fill_between(steps, low, high, color=colour, alpha=0.15, linewidth=0)
        axes.plot(steps, curves.mean(axis=0), style, color=colour, label=shortened(name))
    axes.set_xlabel("control steps of each policy, millions")
    axes.set_ylabel("success, actions drawn")
    axes.set_ylim(-0.03, 1.03)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=2)
    drawn.set_layout_engine("constrained")
    return drawn


def write_figure(file: Path, names: Sequence[str], found: Sequence[Result]) -> None:
    """Draws into a file, whole or not at all; nothing where there is no result yet."""
    if found:
        file.write_bytes(png(figure(names, found)))
