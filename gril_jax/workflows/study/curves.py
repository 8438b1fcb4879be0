"""The policies of a run while they are trained: their curves, their numbers, and Figure 2.

Shapes use E for the evaluations of a policy while it is trained, and n for those of a line.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure

from gril_jax.errors import ShapeError
from gril_jax.metrics.interquartile import interquartile_mean
from gril_jax.report.figures.style import COLOURS, GREY, WIDTH, shortened, styled

from .counted import COUNTS, Counted, read

# Of `at_the_end`.
LAST = ("env_steps", "success", "success_sampled", "success_ever", "score", *COUNTS)

_FEW = 6  # bands that can be told apart where they overlap
_COLUMNS = 3
_SUCCESS = "success, sampled actions"
_SECONDS = "seconds of a program with all its policies"


@dataclass(frozen=True)
class Curve:
    """The learning curve of one policy."""

    cell: int  # place of its row
    seed: int  # place of its seed
    tau: float | None  # of its reward; None where none is learned
    env_steps: Float[np.ndarray, "E"]
    seconds: Float[np.ndarray, "E"]  # of its program, whose other policies it was trained beside
    scores: Mapping[str, Float[np.ndarray, "E"]]  # as `programs.learn_policies` names them
    starts: Mapping[str, Counted] = field(default_factory=dict)
    """Of each evaluation, by variant, that of the first scores first; empty if not recorded."""


def curves(
    finished: Mapping[str, Mapping[str, Any]], metrics: Sequence[Mapping[str, Any]]
) -> list[Curve]:
    """The policies that have finished, by row and seed.

    In the lines of metrics.jsonl a score has one number for each policy of the program.
    """
    found = []
    for phase, done in finished.items():
        if not phase.startswith("policy-"):
            continue
        lines = [x for x in metrics if x["phase"] == phase and "success_sampled" in x]
        named = [name for name, value in lines[-1].items() if isinstance(value, list)]
        values = {
            name: np.array([line[name] for line in lines], float)
            for name in ("env_steps", "seconds", *named)
        }
        steps, seconds = values.pop("env_steps"), values.pop("seconds")
        for i, ((cell, seed), tau) in enumerate(zip(done["rows"], done["taus"], strict=True)):
            own = {name: x[:, i] for name, x in values.items()}
            found.append(Curve(cell, seed, tau, steps, seconds, own, read(done)))
    return sorted(found, key=lambda curve: (curve.cell, curve.seed))


def at_the_end(curve: Curve) -> dict[str, float]:
    """The scores of a policy's last evaluation, the starts that they count if these are recorded,
    and `steps_80` to a success of 80 %."""
    success = curve.scores["success_sampled"]
    last = {name: float(values[-1]) for name, values in curve.scores.items()}
    steps = {"env_steps": float(curve.env_steps[-1])}
    for counted in [*curve.starts.values()][:1]:
        last |= {"starts": counted.distinct, "episodes": counted.episodes}
    return steps | last | {"steps_80": first_at(success, curve.env_steps, level=0.8)}


def first_at(success: Float[np.ndarray, "E"], at: Float[np.ndarray, "E"], *, level: float) -> float:
    """The first of `at` with this share of success, not interpolated; NaN if never reached."""
    reached = success >= level - 1e-6  # shares are float32
    return float(at[np.argmax(reached)]) if reached.any() else float("nan")


def in_last_tenth(env_steps: Float[np.ndarray, "E"]) -> Bool[np.ndarray, "E"]:
    """True for evaluations after nine tenths of the training; for the last one always."""
    return env_steps > 0.9 * env_steps[-1]


class _Line(NamedTuple):
    """A row of the table, from a point before any training on."""

    steps: Float[np.ndarray, "n"]  # millions
    seconds: Float[np.ndarray, "n"]
    success: Float[np.ndarray, "seeds n"]


@styled
def learning_curves(
    names: Sequence[str], found: Sequence[Curve], *, score: str = "success_sampled"
) -> Figure:
    """Success against env steps and against seconds (Figure 2); ShapeError without a curve.

    The score is one with sampled actions. Each row is a line within its band, and many rows have a
    panel each; a row without a policy is left out.
    """
    if not found:
        raise ShapeError("found is empty; it must hold at least one curve.")
    rows: dict[str, list[Curve]] = {}
    for curve in sorted(found, key=lambda curve: curve.cell):
        rows.setdefault(names[curve.cell], []).append(curve)
    lines = {
        name: _Line(
            np.mean([[0.0, *curve.env_steps] for curve in members], axis=0) / 1e6,
            np.mean([[0.0, *curve.seconds] for curve in members], axis=0),
            np.stack([[0.0, *curve.scores[score]] for curve in members]),
        )
        for name, members in rows.items()
    }
    drawn = _overlaid(lines) if len(lines) <= _FEW else _side_by_side(lines)
    drawn.set_layout_engine("constrained")
    return drawn


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
    axes.set(xlabel=x, ylabel=_SUCCESS, ylim=(-0.03, 1.03))


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
    the interquartile mean never is. Each number up to 24 has a look of its own.
    """
    colour = COLOURS[number % len(COLOURS)]
    style = ("-", "--", ":", "-.")[number // len(COLOURS) % 4]
    middle = jax.vmap(interquartile_mean, in_axes=1)(jnp.asarray(curves, jnp.float32))
    low, high = np.quantile(curves, [0.25, 0.75], axis=0)
    axes.fill_between(x, low, high, color=colour, alpha=shade, linewidth=0)
    axes.plot(x, np.asarray(middle), style, color=colour, label=label)
