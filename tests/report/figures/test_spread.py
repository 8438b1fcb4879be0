"""The figure of a comparison over seeds."""

import numpy as np
import pytest

from gril_jax.errors import ShapeError
from gril_jax.report.figures.curves import spread
from gril_jax.report.figures.style import pixels


def test_every_seed_is_a_dot_and_the_mean_a_bar():
    rows = {"one": np.array([0.1, 0.3]), "another $x": np.array([0.5, np.nan, 0.7])}
    (axes,) = spread(rows, "tau").axes
    dots, bar, more, other_bar, line = axes.get_lines()
    np.testing.assert_allclose(dots.get_xdata(), [0.1, 0.3])
    np.testing.assert_allclose(bar.get_xdata(), 0.2)
    np.testing.assert_allclose(more.get_xdata(), [0.5, 0.7])  # what is not finite is left out
    np.testing.assert_allclose(other_bar.get_xdata(), 0.6)
    np.testing.assert_allclose(line.get_xdata(), 0.2)  # the first case, to compare with
    assert [t.get_text() for t in axes.get_yticklabels()] == ["one", "another $x"]
    assert axes.get_ylim()[0] > axes.get_ylim()[1]  # the first case on top


def test_a_figure_grows_with_its_cases_and_is_drawn_even_without_a_finite_value():
    few, many = (spread({str(i): np.array([1.0]) for i in range(n)}, "x") for n in (2, 30))
    assert many.get_figheight() > few.get_figheight() + 5
    assert pixels(spread({"broken": np.array([np.nan])}, "x")).size


def test_nothing_to_draw_is_refused():
    with pytest.raises(ShapeError, match="must hold at least one case"):
        spread({}, "tau")
