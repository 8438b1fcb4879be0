"""Figure 3: the learned reward along a demonstration, with found and true stages."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int, UInt8
from matplotlib.figure import Figure

from gril_jax.report.figures.curves import reward_profile
from gril_jax.report.figures.style import COLOURS, GREY, styled

_GREEN = COLOURS[2]


@styled
def stages_figure(
    reward: Float[np.ndarray, "T"],
    ends: Int[np.ndarray, "K"],
    frames: UInt8[np.ndarray, "T H W 3"],
    *,
    stages: Mapping[str, int] | None = None,
    name: str = "",
    fps: float | None = None,
) -> Figure:
    """The profile with the frames at the found ends; true ends are dashed lines.

    The found ends are last frames of stages; true ones have names, and are -1 for never.

    Raises:
      ShapeError: film and reward differ in length.
    """
    boundary = np.zeros(len(reward), bool)
    boundary[ends[(ends >= 0) & (ends < len(reward))]] = True
    figure = reward_profile(reward, boundary, frames=frames, name=name, fps=fps)
    axes = figure.axes[0]
    if stages:
        figure.text(
            0.988, 1 - 0.08 / figure.get_figheight(), "numbers: stages found; dashed: true ends",
            ha="right", va="top", fontsize=9, color=GREY,
        )  # fmt: skip
    for stage, frame in (stages or {}).items():
        if 0 <= frame < len(reward):
            axes.axvline(frame, color=_GREEN, linestyle="--", linewidth=1.2, zorder=1)
            axes.annotate(
                stage, (frame, 0), (-3, 5), xycoords=("data", "axes fraction"),
                textcoords="offset points", color=_GREEN, fontsize=9, ha="right",
            )  # fmt: skip
    return figure
