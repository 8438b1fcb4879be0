"""Figure 2: success while policies are trained, against env steps and against seconds."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from gril_jax.errors import ShapeError
from gril_jax.plot_style import WIDTH, shortened, styled
from gril_jax.sweep_plot import draw_spread

from .table1_scores import Curve

__all__ = ["figure"]

_FEW = 6  # bands that can be told apart where they overlap


@styled
def figure(found: Sequence[Curve]) -> Figure:
    """A panel for each of the two; a row of the table is a line within its band.

    Raises:
      ShapeError: there is no curve.
    """
    if not found:
        raise ShapeError("found is empty; it must hold at least one curve.")
    names = list(dict.fromkeys(curve.row for curve in found))
    shade = 0.15 if len(names) <= _FEW else 0.07
    drawn = Figure(figsize=(WIDTH, 0.85 * WIDTH + 0.11 * len(names)))
    panels = drawn.subplots(2, 1)
    for number, name in enumerate(names):
        members = [curve for curve in found if curve.row == name]
        success = np.stack([curve.scores["success_sampled"] for curve in members])
        success = np.concatenate([np.zeros((len(members), 1)), success], axis=1)
        steps = np.mean([curve.env_steps for curve in members], axis=0) / 1e6
        seconds = np.mean([curve.seconds for curve in members], axis=0)
        for axes, x in zip(panels, (steps, seconds), strict=True):
            x = np.concatenate([[0.0], x])
            draw_spread(axes, x, success, number=number, label=shortened(name), shade=shade)
    panels[0].set_xlabel("env steps of each policy, millions")
    panels[1].set_xlabel("seconds of a program with all its policies")
    for axes in panels:
        axes.set_ylabel("success, actions drawn, Demo starts")
        axes.set_ylim(-0.03, 1.03)
    drawn.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    drawn.set_layout_engine("constrained")
    return drawn
