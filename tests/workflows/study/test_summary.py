"""Success while policies are trained: what is drawn for each row."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from gril_jax.errors import ShapeError
from gril_jax.report.style import COLOURS, png
from gril_jax.workflows.study.results import Curve
from gril_jax.workflows.study.summary import draw_spread, learning_curves


def _curves(rows, seeds=5, evaluations=4):
    draw = np.random.default_rng(0)
    at = np.arange(1.0, evaluations + 1)
    return [
        Curve(i, k, None, 1e6 * at, {"success_sampled": draw.uniform(size=evaluations)})
        for i in range(rows)
        for k in range(seeds)
    ]


def test_a_line_is_the_interquartile_mean_within_the_quartiles_and_a_row_without_policies_lacks():
    found = _curves(2)
    panels = learning_curves(["a", "b", "not yet"], found).axes
    assert [panel.lines[0].get_label() for panel in panels] == ["a", "b"]
    for cell, panel in enumerate(panels):
        line, (band,) = panel.lines[0], panel.collections
        curves = [[0, *c.scores["success_sampled"]] for c in found if c.cell == cell]
        middle = np.sort(curves, axis=0)[1:4].mean(axis=0)  # of five, one off at each end
        np.testing.assert_allclose(line.get_ydata(), middle, rtol=1e-6)
        np.testing.assert_allclose(line.get_xdata(), np.arange(5))
        extent = band.get_paths()[0].vertices[:, 1]
        low, high = np.quantile(curves, [0.25, 0.75], axis=0)
        np.testing.assert_allclose([extent.min(), extent.max()], [low.min(), high.max()])


@pytest.mark.parametrize("seeds", [1, 2, 3, 4, 5, 6, 7, 10])
def test_the_line_lies_inside_its_band_whatever_single_seeds_do(seeds):
    curves = np.random.default_rng(seeds).uniform(size=(seeds, 40)) ** 8  # most near 0, few near 1
    axes = Figure().add_subplot()
    draw_spread(axes, np.arange(40.0), curves, number=0, label="a")
    low, high = np.quantile(curves, [0.25, 0.75], axis=0)
    line = axes.lines[0].get_ydata()
    assert (line >= low - 1e-6).all()
    assert (line <= high + 1e-6).all()


def test_many_rows_have_a_panel_each_and_are_told_apart_where_they_meet():
    names = [f"row {i}" for i in range(2 * len(COLOURS) + 1)]
    found = _curves(len(names), seeds=2)
    drawn = learning_curves(names, found)
    panels = [axes for axes in drawn.axes if axes.axison]
    assert [panel.get_title(loc="left") for panel in panels] == names
    looks = {(panel.lines[0].get_color(), panel.lines[0].get_linestyle()) for panel in panels}
    assert len(looks) == len(names)
    first, *others = panels
    for cell, panel in enumerate(others, 1):
        own, reference = panel.lines
        middle = np.mean([[0, *c.scores["success_sampled"]] for c in found if c.cell == cell], 0)
        np.testing.assert_allclose(own.get_ydata(), middle, rtol=1e-6)
        np.testing.assert_array_equal(reference.get_ydata(), first.lines[0].get_ydata())
    assert png(drawn).startswith(b"\x89PNG")


def test_of_nothing_no_figure_is_drawn():
    with pytest.raises(ShapeError, match="at least one curve"):
        learning_curves([], [])
