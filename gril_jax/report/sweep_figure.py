"""A sweep's figure: success while policies are trained, one line a cell with its seeds' spread."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from gril_jax.metrics.interquartile import interquartile_mean
from gril_jax.report.figures.style import COLOURS, WIDTH, png, shortened, styled

from .sweep_table import Result

__all__ = ["draw_spread", "figure", "write_figure"]


@styled
def figure(names: Sequence[str], found: Sequence[Result]) -> Figure:
    """The interquartile mean of each cell's seeds, and from their lower to their upper quartile.

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
        draw_spread(axes, steps, curves, number=cell, label=shortened(name))
    axes.set_xlabel("control steps of each policy, millions")
    axes.set_ylabel("success, actions drawn")
    axes.set_ylim(-0.03, 1.03)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=2)
    drawn.set_layout_engine("constrained")
    return drawn


def draw_spread(
    axes: Any,
    x: Float[np.ndarray, "n"],
    curves: Float[np.ndarray, "seeds n"],
    *,
    number: int,
    label: str,
    shade: float = 0.15,
) -> None:
    """A line at the interquartile mean over seeds, within a band from quartile to quartile.

    The mean is left out: one seed that fails or excels can carry it outside of the quartiles, where
    the interquartile mean never is.

    Args:
      axes: to draw on.
      x: of the points.
      curves: one for each seed.
      number: of the line; it has a colour, or a colour and a style, of its own up to 24.
      label: for the legend.
      shade: opacity of the band; less where many bands lie over each other.
    """
    colour = COLOURS[number % len(COLOURS)]
    style = ("-", "--", ":", "-.")[number // len(COLOURS) % 4]
    middle = jax.vmap(interquartile_mean, in_axes=1)(jnp.asarray(curves, jnp.float32))
    low, high = np.quantile(curves, [0.25, 0.75], axis=0)
    axes.fill_between(x, low, high, color=colour, alpha=shade, linewidth=0)
    axes.plot(x, np.asarray(middle), style, color=colour, label=label)


def write_figure(file: Path, names: Sequence[str], found: Sequence[Result]) -> None:
    """Draws into a file, whole or not at all; nothing where there is no result yet."""
    if found:
        file.write_bytes(png(figure(names, found)))
