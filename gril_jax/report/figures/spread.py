"""A number for each of several cases, with all its seeds: one row per case."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from gril_jax.errors import ShapeError

from .style import COLOURS, GREY, WIDTH, shortened, styled

_ROW, _MARGIN = 0.27, 0.75  # inches


@styled
def spread(rows: Mapping[str, Float[np.ndarray, "seeds"]], label: str) -> Figure:
    """A dot for each seed and a bar at their mean; the first case's mean is a line through all.

    Values that are not finite are left out; no case at all is a `ShapeError`.
    """
    if not rows:
        raise ShapeError("rows is empty; it must hold at least one case.")
    height = _ROW * len(rows) + _MARGIN
    figure = Figure(figsize=(WIDTH, height))
    axes = figure.add_axes((0.36, 0.55 / height, 0.62, _ROW * len(rows) / height))
    for at, values in enumerate(rows.values()):
        known = values[np.isfinite(values)]
        axes.plot(known, np.full(len(known), at), "o", color=COLOURS[0], alpha=0.55, markersize=5)
        if len(known):
            axes.plot([known.mean()] * 2, [at - 0.3, at + 0.3], color=COLOURS[1], linewidth=2.2)
    first = next(iter(rows.values()))
    if np.isfinite(first).any():
        axes.axvline(np.nanmean(first), color=GREY, linewidth=0.8, linestyle=":")
    axes.set_yticks(range(len(rows)), [shortened(name) for name in rows])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlabel(label)
    return figure
