"""Curves: the learned reward along demonstrations, encoder and policy training, cases over seeds.

Each function returns a figure that nothing else refers to; `png` of `gril_jax.report.style`
turns it into a file. T is frames of a demonstration, K pictures on a strip.
"""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import ConnectionPatch

from gril_jax.demos.demo_set import padded
from gril_jax.errors import ShapeError

from .style import COLOURS, GREY, HALF, INK, WIDTH, shortened, styled

_BLUE, _RED, _GREEN = COLOURS[:3]
_EXAMINED = {"linestyle": "none", "marker": "s", "color": INK, "markersize": 5}
_BY_MEANS, _BY_SAMPLES = "evaluated, deterministic", "evaluated, sampled"
_MOST = 7  # pictures on a strip: more would be too small to see a block in
_LARGEST = 1.7  # inches: a picture on a strip of few
_BELOW, _CURVE, _TIES, _ABOVE = 0.55, 2.9, 0.3, 0.5  # inches: parts of a profile's height
_ROW = 0.27  # inches: a case of `spread`


@styled
def reward_profile(
    reward: Float[np.ndarray, "T"],
    boundary: Bool[np.ndarray, "T"],
    *,
    frames: UInt8[np.ndarray, "V H W 3"] | None = None,
    name: str = "",
    fps: float | None = None,
) -> Figure:
    """The learned reward along one demonstration, with its stages and the frames between them.

    Args:
      boundary: frames at which a stage ends (`gril_jax.subtasks.agreement`).
      frames: the video, of V = T frames, or a ShapeError; its first frame, those at the boundaries
        and the last are shown above the curve, seven at the most. None shows the curve alone.
      name, fps: of the demonstration, for the title and the axis.
    """
    if frames is not None and len(frames) != len(reward):
        raise ShapeError(
            f"frames: the video has {len(frames)} frames, but the reward is of {len(reward)}."
        )
    ends = np.flatnonzero(boundary)
    shown = _to_show(ends, len(reward))
    side = 0.0 if frames is None else min(_LARGEST, HALF / len(shown))
    height = _BELOW + _CURVE + _ABOVE + (side + _TIES if side else 0)
    figure = Figure(figsize=(HALF, height))
    axes = figure.add_axes((0.1, _BELOW / height, 0.885, _CURVE / height))
    _stages(axes, reward, ends)
    axes.set_xlabel(f"frame ({fps:g} a second)" if fps else "frame")
    axes.set_ylabel("learned reward")
    title = f"Learned reward along {shortened(name)}" if name else "Learned reward"
    figure.text(0.012, 1 - 0.08 / height, title, va="top", fontsize=11)
    if frames is not None:
        _strip(figure, axes, frames, reward, ends, shown, side)
    return figure


def _to_show(ends: Int[np.ndarray, "S"], length: int) -> Int[np.ndarray, "K"]:
    """Frames to show: the first, stage ends (evenly thinned out if there are many), the last."""
    inner = ends[(ends > 0) & (ends < length - 1)]
    few = min(len(inner), _MOST - 2)
    inner = inner[np.linspace(0, len(inner) - 1, few).round().astype(int)]
    return np.unique([0, *inner, length - 1])


def _stages(axes: Axes, reward: np.ndarray, ends: np.ndarray) -> None:
    """Draws the curve on bands for the stages; each stage's end has a number."""
    last = len(reward) - 1
    edges = np.unique([0, *ends, last])
    for start, end in list(itertools.pairwise(edges))[1::2]:
        axes.axvspan(start, end, color="#F3F3F3", linewidth=0, zorder=0)
    axes.plot(reward, color=_BLUE)
    axes.plot(ends, reward[ends], "o", color=_RED, markersize=6, zorder=4)
    for number, end in enumerate(ends, 1):
        axes.annotate(
            str(number), (end, reward[end]), (6, -6), textcoords="offset points",
            color=_RED, weight="bold", va="top", zorder=5,
        )  # fmt: skip
    axes.margins(x=0.015, y=0.1)


def _strip(figure, axes, frames, reward, ends, shown, side) -> None:
    """Draws pictures above the axes, each joined to its point of the curve by a thin line."""
    width, height = figure.get_size_inches()
    bottom = _BELOW + _CURVE + _TIES
    gap = (width - side * len(shown)) / (len(shown) + 1)
    inset = 0.04 * side
    size = side - 2 * inset
    for i, frame in enumerate(shown):
        left = gap + i * (side + gap) + inset
        picture = figure.add_axes((left / width, bottom / height, size / width, size / height))
        picture.imshow(frames[frame], interpolation="antialiased")
        picture.set(xticks=[], yticks=[])
        picture.grid(False)
        label, colour, rim = f"frame {frame}", INK, "#AAAAAA"
        if frame in ends:
            label, colour, rim = f"{np.searchsorted(ends, frame) + 1}: {label}", _RED, _RED
        for spine in picture.spines.values():
            spine.set(visible=True, color=rim)
        picture.set_title(label, fontsize=9, color=colour, loc="center", pad=3)
        if np.isfinite(reward[frame]):
            both = (0.5, 0), (frame, reward[frame]), picture.transAxes, axes.transData
            tie = ConnectionPatch(*both, color="#9A9A9A", linewidth=0.8, shrinkB=4)
            figure.add_artist(tie)


@styled
def success_failure(
    success: Sequence[Float[np.ndarray, "_"]], failure: Sequence[Float[np.ndarray, "_"]]
) -> Figure:
    """Learned rewards of successful and of failed demonstrations, at least one each, and their
    means, which hold a trace's last value once it has ended."""
    figure = Figure(figsize=(HALF, 2.8), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, traces, word, words, colour in (
        (panels[0], success, "success", "successes", _BLUE),
        (panels[1], failure, "failure", "failures", _RED),
    ):
        for trace in traces:
            axes.plot(trace, color=colour, linewidth=0.8, alpha=0.4)
        axes.plot(padded(traces).mean(axis=0), color=INK, linewidth=2.2, label="mean")
        ends = np.array([(len(trace) - 1, trace[-1]) for trace in traces]).T
        axes.plot(*ends, ".", color=colour, markersize=6, label="end of a demonstration")
        axes.set_title(f"{len(traces)} {word if len(traces) == 1 else words}")
        axes.set_xlabel("frame")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    panels[0].set_ylabel("learned reward")
    panels[0].margins(x=0.02, y=0.08)
    return figure


@styled
def learning_curve(
    rows: Sequence[Mapping[str, Any]],
    *,
    random_success: float | None = None,
    offset: float = 0.0,
) -> Figure:
    """Success rate and mean reward against environment steps; the random policy is a dashed line.

    The offset is taken from the reward, which then has the range that demonstrations show.

    Rows have "env_steps" and some of "success" (from 0 to 1), "reward", "episodes", "eval/success"
    and "eval/success_sampled". A value of None is left out, and so is the success of a row in which
    no episode ended.
    """
    figure = Figure(figsize=(HALF, 4.2), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    most = max((row["env_steps"] for row in rows), default=0)
    units = ((1e6, "million "), (1e3, "thousand "), (1.0, ""))
    unit, word = next((u, w) for u, w in units if most >= 2 * u or u == 1.0)
    for axes, field, factor, look in (
        (above, "success", 100, {"color": _BLUE, "markersize": 3.5, "label": "trained policy"}),
        (below, "reward", 1, {"color": _GREEN, "markersize": 3.5, "label": "trained policy"}),
        (above, "eval/success", 100, _EXAMINED | {"marker": "D", "label": _BY_MEANS}),
        (above, "eval/success_sampled", 100, _EXAMINED | {"markerfacecolor": "white",
                                                         "label": _BY_SAMPLES}),
    ):  # fmt: skip
        steps, values = _points(rows, field)
        values = values - offset * (field == "reward")
        few = "o" if len(steps) <= 40 else None
        if len(steps):
            axes.plot(steps / unit, factor * values, **{"marker": few} | look)
    if random_success is not None:
        look = {"color": GREY, "linestyle": "--", "label": "random policy"}
        above.axhline(100 * random_success, zorder=1, **look)
    above.set(title="Success", ylabel="episodes, %", ylim=(-3, 103))
    below.set(title="Reward", ylabel="mean of a step", xlabel=f"{word}environment steps")
    figure.legend(*above.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def _points(rows, field: str) -> tuple[np.ndarray, np.ndarray]:
    """Steps and values in order of steps; of two equal steps the later row."""
    points: dict[float, float] = {}
    for row in rows:
        nothing_ended = field == "success" and row.get("episodes") == 0
        if row.get(field) is not None and not nothing_ended:
            points[row["env_steps"]] = row[field]
    return tuple(np.array(sorted(points.items()), float).reshape(-1, 2).T)


@styled
def pretrain_curve(rows: Sequence[Mapping[str, Any]], weights: Mapping[str, float]) -> Figure:
    """The encoder's loss and its parts, which add up to it, against gradient steps.

    Rows have "step" and some of "loss", "consistency", "reconstruction" and "contrast"; None is
    left out. A part counts with its weight (default 1); one that is always 0 is left out.
    """
    rows = [_with_parts(row, weights) for row in rows]
    figure = Figure(figsize=(HALF, 2.8), layout="constrained")
    axes = figure.subplots()
    lowest = []
    for field, label, colour, dash in (
        ("loss", "total", INK, "-"),
        ("consistency", "consistency in time", _BLUE, "--"),
        ("reconstruction", "reconstruction", _RED, ":"),
        ("contrast", "perturbed frames", _GREEN, "-."),
        ("agreement", "times aligned directly", GREY, "--"),
    ):
        points = [(r["step"], r[field]) for r in rows if r.get(field) is not None]
        if points and (field == "loss" or any(value for _, value in points)):
            kept = [x for x in points if field == "loss" or x[1]]  # a part that is 0 has ended
            steps, values = np.array(kept, float).T
            axes.plot(steps, values, color=colour, linestyle=dash, label=label)
            lowest.append(values.min())
    if lowest and min(lowest) > 0:
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
        # Ticks at 2, 3, ... 9: naming two of them is enough to read a range of a decade or so.
        named = "25" if axes.get_ylim()[1] < 100 * axes.get_ylim()[0] else ""
        axes.yaxis.set_minor_formatter(lambda x, _: f"{x:g}" if f"{x:e}"[0] in named else "")
        axes.tick_params(axis="y", which="minor", labelsize=9)
    axes.set(title="Encoder training", xlabel="gradient steps", ylabel="loss")
    axes.legend(loc="best")
    return figure


def _with_parts(row: Mapping[str, Any], weights: Mapping[str, float]) -> dict[str, Any]:
    """A row with its parts times their weights, and as "agreement" what these leave of the loss."""
    parts = {
        name: weights.get(name, 1.0) * row[name]
        for name in ("consistency", "reconstruction", "contrast")
        if row.get(name) is not None
    }
    found = {"step": row["step"], "loss": row.get("loss"), **parts}
    if row.get("loss") is not None and "consistency" in parts:
        left = row["loss"] - sum(parts.values())
        found["agreement"] = left if left > 1e-3 * abs(row["loss"]) else 0.0  # rounding
    return found


@styled
def spread(rows: Mapping[str, Float[np.ndarray, "seeds"]], label: str) -> Figure:
    """A dot for each seed and a bar at their mean; the first case's mean is a line through all.

    Values that are not finite are left out; no case at all is a `ShapeError`.
    """
    if not rows:
        raise ShapeError("rows is empty; it must hold at least one case.")
    height = _ROW * len(rows) + 0.75
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
