"""Figures of an audit: the reward of each place of each object, and single states.

Shapes use N for objects, M for those that are swept and G for a side of a grid.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from gril_jax.audit.scene_reward import Scene

from .style import COLOURS, GREY, HALF, shortened, styled

_MOST = 6  # maps in a row


class Situation(NamedTuple):
    """Maps of one situation: the places of the other objects while one is swept."""

    title: str
    scene: Scene
    reward: Float[np.ndarray, "M G G"]  # rows go up in y


@styled
def reward_maps(
    situations: Sequence[Situation],
    names: Sequence[str],
    swept: Sequence[int],
    *,
    half_extent: float,
) -> Figure:
    """A heat map for each of the swept objects in each situation, with one colour scale; the names
    are those of all N objects."""
    columns = min(len(swept), _MOST)
    rows_each = -(-len(swept) // columns)
    rows = rows_each * len(situations)
    height = 0.3 + rows * (0.2 + 0.92 * HALF / max(columns, 3))
    figure = Figure(figsize=(HALF, height), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False)
    values = np.concatenate([s.reward.ravel() for s in situations])
    low, high = np.nanmin(values), np.nanmax(values)
    for axes in panels.ravel():
        axes.set_visible(False)
    for row, situation in enumerate(situations):
        for column, index in enumerate(swept):
            axes = panels[row * rows_each + column // columns, column % columns]
            axes.set_visible(True)
            image = _map(axes, situation, column, index, low, high, half_extent)
            axes.set_title(shortened(names[index], 20), fontsize=9)
            if column % columns == 0:
                axes.set_ylabel(situation.title, fontsize=9)
    bar = figure.colorbar(image, ax=panels, shrink=0.8, aspect=25)
    bar.set_label("learned reward")
    bar.outline.set_visible(False)
    return figure


def _map(axes: Axes, situation: Situation, row: int, index: int, low, high, half_extent):
    """One object's map; its centre stays where its box fits into the plane."""
    scene = situation.scene
    x, y = np.maximum(half_extent - scene.size[index] / 2, 0)
    image = axes.imshow(
        situation.reward[row], origin="lower", extent=(-x, x, -y, y), cmap="viridis",
        vmin=low, vmax=high, interpolation="nearest",
    )  # fmt: skip
    for other in range(len(scene.center)):
        if other != index:
            _box(axes, scene, other, color="white", linewidth=1.0)
    axes.plot(*scene.center[index], "o", color=COLOURS[1], markersize=5, markeredgecolor="white")
    _plane(axes, half_extent)
    return image


@styled
def state_pictures(
    states: Sequence[tuple[str, Scene]], names: Sequence[str], *, half_extent: float
) -> Figure:
    """Titled states side by side as boxes; thick boxes have their activity bit set."""
    figure = Figure(figsize=(HALF, 0.5 * HALF), layout="constrained")
    panels = figure.subplots(1, len(states), squeeze=False)[0]
    for axes, (title, scene) in zip(panels, states, strict=True):
        for i in range(len(names)):
            _box(axes, scene, i, linewidth=2.6 if scene.active[i] else 0.9, **_look(i))
        axes.set_title(title, fontsize=9)
        _plane(axes, half_extent)
    looks = map(_look, range(len(names)))
    known = [Rectangle((0, 0), 1, 1, fill=False, linewidth=1.6, **look) for look in looks]
    words = [shortened(name, 18) for name in names]
    figure.legend(known, words, loc="outside lower center", ncols=3, fontsize=8)
    return figure


def _look(index: int) -> dict[str, str]:
    """Colour and line style of an object's box; distinct for twice as many objects as colours."""
    line = "--" if index // len(COLOURS) % 2 else "-"
    return {"color": COLOURS[index % len(COLOURS)], "linestyle": line}


def _box(axes: Axes, scene: Scene, index: int, **look) -> None:
    corner = scene.center[index] - scene.size[index] / 2
    axes.add_patch(Rectangle(corner, *scene.size[index], fill=False, **look))


def _plane(axes: Axes, half_extent: float) -> None:
    axes.set(xlim=(-half_extent, half_extent), ylim=(-half_extent, half_extent), aspect="equal")
    axes.set(xticks=[], yticks=[])
    axes.grid(False)
    for spine in axes.spines.values():
        spine.set(visible=True, color=GREY)
