"""Success while policies are trained, against env steps and against seconds (Figure 2)."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from gril_jax.errors import ShapeError
from gril_jax.metrics.interquartile import interquartile_mean
from gril_jax.report.figures.style import COLOURS, GREY, WIDTH, shortened, styled

from .curves import Curve

_FEW = 6  # bands that can be told apart where they overlap
_COLUMNS = 3
_SUCCESS = "success, sampled actions"
_SECONDS = "seconds of a program with all its policies"


class _Line(NamedTuple):
    """A row of the table as n points of its policies, the first before any training."""

    steps: Float[np.ndarray, "n"]  # millions
    seconds: Float[np.ndarray, "n"]
    success: Float[np.ndarray, "seeds n"]


@styled
def learning_curves(names: Sequence[str], found: Sequence[Curve]) -> Figure:
    """The figure; each row is a line within its band, and many rows have a panel each.

    A row without a policy is left out.

    Raises:
      ShapeError: there is no curve.
    """
    if not found:
        raise ShapeError("found is empty; it must hold at least one curve.")
    rows: dict[str, list[Curve]] = {}
    for curve in sorted(found, key=lambda curve: curve.cell):
        rows.setdefault(names[curve.cell], []).append(curve)
    lines = {name: _line(members) for name, members in rows.items()}
    drawn = _overlaid(lines) if len(lines) <= _FEW else _side_by_side(lines)
    drawn.set_layout_engine("constrained")
    return drawn


def _line(members: Sequence[Curve]) -> _Line:
    success = np.stack([curve.scores["success_sampled"] for curve in members])
    steps = np.mean([curve.env_steps for curve in members], axis=0) / 1e6
    seconds = np.mean([curve.seconds for curve in members], axis=0)
    start = np.zeros((len(members), 1))
    return _Line(np.r_[0.0, steps], np.r_[0.0, seconds], np.concatenate([start, success], axis=1))


def _overlaid(lines: Mapping[str, _Line]) -> Figure:
    drawn = Figure(figsize=(WIDTH, 0.85 * WIDTH + 0.11 * len(lines)))
    over_steps, over_seconds = drawn.subplots(2, 1)
    for number, (name, line) in enumerate(lines.items()):
        look: dict[str, Any] = {"number": number, "label": shortened(name)}
        draw_spread(over_steps, line.steps, line.success, **look)
        draw_spread(over_seconds, line.seconds, line.success, **look)
    _label(over_steps, "env steps of each policy, millions")
    _label(over_seconds, _SECONDS)
    drawn.legend(*over_steps.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return drawn


def _side_by_side(lines: Mapping[str, _Line]) -> Figure:
    """Panels against steps, one per row with the first row's line; one against seconds for all."""
    down = math.ceil(len(lines) / _COLUMNS)
    drawn = Figure(figsize=(WIDTH, 1.75 * down + 0.45 * WIDTH))
    above, below = drawn.subfigures(2, 1, height_ratios=[1.75 * down, 0.45 * WIDTH])
    panels = above.subplots(down, _COLUMNS, sharex=True, sharey=True).ravel()
    over_seconds = below.subplots()
    for number, (name, line) in enumerate(lines.items()):
        look: dict[str, Any] = {"number": number, "label": shortened(name)}
        draw_spread(panels[number], line.steps, line.success, **look)
        panels[number].set_title(shortened(name), fontsize=10)
        if number:
            panels[number].plot(*panels[0].lines[0].get_data(), ":", color=GREY)
        draw_spread(over_seconds, line.seconds, line.success, shade=0.0, **look)
    for panel in panels[len(lines) :]:
        panel.set_axis_off()
    first = shortened(next(iter(lines)))
    above.supxlabel(f"env steps of each policy, millions (dotted: {first})", fontsize=10)
    above.supylabel(_SUCCESS, fontsize=10)
    panels[0].set_ylim(-0.03, 1.03)
    _label(over_seconds, _SECONDS)
    below.legend(*over_seconds.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return drawn


def _label(axes: Any, x: str) -> None:
    axes.set_xlabel(x)
    axes.set_ylabel(_SUCCESS)
    axes.set_ylim(-0.03, 1.03)


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

    Each number has a colour, or a colour and a style, of its own up to 24.
    """
    colour = COLOURS[number % len(COLOURS)]
    style = ("-", "--", ":", "-.")[number // len(COLOURS) % 4]
    middle = jax.vmap(interquartile_mean, in_axes=1)(jnp.asarray(curves, jnp.float32))
    low, high = np.quantile(curves, [0.25, 0.75], axis=0)
    axes.fill_between(x, low, high, color=colour, alpha=shade, linewidth=0)
    axes.plot(x, np.asarray(middle), style, color=colour, label=label)
