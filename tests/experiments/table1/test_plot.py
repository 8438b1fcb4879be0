"""Figure 2: what is drawn for each row, with as many rows as the table has."""

import numpy as np
import pytest
from gril_jax.experiments.table1.plot import figure
from gril_jax.experiments.table1.rows import ROWS
from gril_jax.experiments.table1.scores import Curve

from gril_jax.errors import ShapeError
from gril_jax.report.figures.style import png


def _curves(rows, seeds=5, evaluations=4):
    draw = np.random.default_rng(0)
    at = np.arange(1.0, evaluations + 1)
    return [
        Curve(row, k, 1e6 * at, 10 * at, {"success_sampled": draw.uniform(size=evaluations)})
        for row in rows
        for k in range(seeds)
    ]


def test_a_line_is_the_interquartile_mean_against_steps_and_against_seconds():
    found = _curves(["a", "b"])
    left, right = figure(found).axes
    for axes, unit in ((left, 1.0), (right, 10.0)):
        assert [line.get_label() for line in axes.lines] == ["a", "b"]
        for row, line in zip("ab", axes.lines, strict=True):
            curves = [[0, *c.scores["success_sampled"]] for c in found if c.row == row]
            middle = np.sort(curves, axis=0)[1:4].mean(axis=0)
            np.testing.assert_allclose(line.get_ydata(), middle, rtol=1e-6)
            np.testing.assert_allclose(line.get_xdata(), unit * np.arange(5))


def test_many_rows_have_a_panel_each_and_are_told_apart_where_they_meet():
    found = _curves(ROWS, seeds=2)
    drawn = figure(found)
    *panels, together = [axes for axes in drawn.axes if axes.axison]
    assert [panel.get_title(loc="left") for panel in panels] == [*ROWS]
    looks = {(line.get_color(), line.get_linestyle()) for line in together.lines}
    assert len(looks) == len(together.lines) == len(ROWS)
    first, *others = panels
    for name, panel in zip(list(ROWS)[1:], others, strict=True):
        own, reference = panel.lines
        middle = np.mean([[0, *c.scores["success_sampled"]] for c in found if c.row == name], 0)
        np.testing.assert_allclose(own.get_ydata(), middle, rtol=1e-6)
        np.testing.assert_array_equal(reference.get_ydata(), first.lines[0].get_ydata())
    assert png(drawn).startswith(b"\x89PNG")


def test_of_nothing_no_figure_is_drawn():
    with pytest.raises(ShapeError, match="at least one curve"):
        figure([])
