"""The policies of a run while they are trained: their curves, and what these come to.

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
from gril_jax.metrics.order import interquartile_mean
from gril_jax.report.figures.style import COLOURS, GREY, WIDTH, shortened, styled

from .counted import Counted, read

LEVELS = (50, 80, 95)  # percent of success that is waited for

_FEW = 6  # bands that can be told apart where they overlap
_COLUMNS = 3
_SUCCESS = "success, sampled actions"


@dataclass(frozen=True)
class Curve:
    """The learning curve of one policy."""

    cell: int  # place of its row
    seed: int  # place of its seed
    tau: float | None  # of its reward; None where none is learned
    env_steps: Float[np.ndarray, "E"]
    scores: Mapping[str, Float[np.ndarray, "E"]]  # as `programs.learn_policies` names them
    starts: Mapping[str, Counted] = field(default_factory=dict)
    """Of each evaluation, by variant, that of the first scores first; empty if not recorded."""

    @property
    def headline(self) -> str:
        """What stands behind the names of the scores that tell most: those of the first variant
        that has several starts, such as "_jitter"; "" for the first of all."""
        several = [name for name, counted in self.starts.items() if counted.distinct > 1]
        return "" if not several or several[0] == next(iter(self.starts)) else f"_{several[0]}"


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
        values = {name: np.array([line[name] for line in lines], float) for name in named}
        steps = np.array([line["env_steps"] for line in lines], float)
        for i, ((cell, seed), tau) in enumerate(zip(done["rows"], done["taus"], strict=True)):
            own = {name: x[:, i] for name, x in values.items()}
            found.append(Curve(cell, seed, tau, steps, own, read(done)))
    return sorted(found, key=lambda curve: (curve.cell, curve.seed))


def numbers(curve: Curve) -> dict[str, float]:
    """What a policy came to: each score as its mean over the evaluations in the last tenth of its
    training, the starts that one of them counts, and steps to levels of success."""
    last = in_last_tenth(curve.env_steps)
    found = {name: float(values[last].mean()) for name, values in curve.scores.items()}
    found["env_steps"] = float(curve.env_steps[-1])
    for counted in [*curve.starts.values()][:1]:
        found |= {"starts": counted.distinct, "episodes": counted.episodes}
    success = curve.scores[f"success{curve.headline}_sampled"]
    for level in LEVELS:
        found[f"steps_{level}"] = first_at(success, curve.env_steps, level=level / 100)
    return found


def first_at(success: Float[np.ndarray, "E"], at: Float[np.ndarray, "E"], *, level: float) -> float:
    """The first of `at` with this share of success, not interpolated; NaN if never reached."""
    reached = success >= level - 1e-6  # shares are float32
    return float(at[np.argmax(reached)]) if reached.any() else float("nan")


def in_last_tenth(env_steps: Float[np.ndarray, "E"]) -> Bool[np.ndarray, "E"]:
    """True for evaluations after nine tenths of the training; for the last one always."""
    return env_steps > 0.9 * env_steps[-1]


class _Line(NamedTuple):
    """A row, from a point before any training on."""

    steps: Float[np.ndarray, "n"]  # millions
    success: Float[np.ndarray, "seeds n"]


@styled
def learning_curves(names: Sequence[str], found: Sequence[Curve]) -> Figure:
    """Success with sampled actions against env steps; ShapeError without a curve.

    Each row is a line within its band, and many rows have a panel each; a row without a policy is
    left out.
    """
    if not found:
        raise ShapeError("found is empty; it must hold at least one curve.")
    rows: dict[str, list[Curve]] = {}
    for curve in sorted(found, key=lambda curve: curve.cell):
        rows.setdefault(names[curve.cell], []).append(curve)
    lines = {
        name: _Line(
            np.mean([[0.0, *curve.env_steps] for curve in members], axis=0) / 1e6,
            np.stack(
                [[0.0, *curve.scores[f"success{curve.headline}_sampled"]] for curve in members]
            ),
        )
        for name, members in rows.items()
    }
    drawn = _overlaid(lines) if len(lines) <= _FEW else _side_by_side(lines)
    drawn.supxlabel("env steps of each policy, millions", fontsize=10)
    drawn.supylabel(_SUCCESS, fontsize=10)
    drawn.set_layout_engine("constrained")
    return drawn


def _overlaid(lines: Mapping[str, _Line]) -> Figure:
    drawn = Figure(figsize=(WIDTH, 0.5 * WIDTH + 0.11 * len(lines)))
    axes = drawn.subplots()
    for number, (name, line) in enumerate(lines.items()):
        draw_spread(axes, line.steps, line.success, number=number, label=shortened(name))
    axes.set_ylim(-0.03, 1.03)
    drawn.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return drawn


def _side_by_side(lines: Mapping[str, _Line]) -> Figure:
    """A panel for each row, with the first row's line."""
    down = math.ceil(len(lines) / _COLUMNS)
    drawn = Figure(figsize=(WIDTH, 1.75 * down + 0.4))
    panels = drawn.subplots(down, _COLUMNS, sharex=True, sharey=True, squeeze=False).ravel()
    for number, (name, line) in enumerate(lines.items()):
        label = shortened(name)
        draw_spread(panels[number], line.steps, line.success, number=number, label=label)
        panels[number].set_title(label, fontsize=10)
        if number:
            panels[number].plot(*panels[0].lines[0].get_data(), ":", color=GREY)
    for panel in panels[len(lines) :]:
        panel.set_axis_off()
    panels[0].set_ylim(-0.03, 1.03)
    return drawn


def draw_spread(
    axes: Any,
    x: Float[np.ndarray, "n"],
    curves: Float[np.ndarray, "seeds n"],
    *,
    number: int,
    label: str,
) -> None:
    """A line at the interquartile mean over seeds, within a band from quartile to quartile.

    The mean is left out: one seed that fails or excels can carry it outside of the quartiles, where
    the interquartile mean never is. Each number up to 24 has a look of its own.
    """
    colour = COLOURS[number % len(COLOURS)]
    style = ("-", "--", ":", "-.")[number // len(COLOURS) % 4]
    middle = jax.vmap(interquartile_mean, in_axes=1)(jnp.asarray(curves, jnp.float32))
    low, high = np.quantile(curves, [0.25, 0.75], axis=0)
    axes.fill_between(x, low, high, color=colour, alpha=0.15, linewidth=0)
    axes.plot(x, np.asarray(middle), style, color=colour, label=label)
