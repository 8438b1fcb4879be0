"""The figure of a sweep: what is drawn for each cell, and that nothing stops it."""

import numpy as np
import pytest
from gril_jax.report.sweep_figure import draw_spread, figure, write_figure
from gril_jax.report.sweep_table import Result
from matplotlib.figure import Figure

from gril_jax.report.figures.style import COLOURS


def _results(cells, seeds=3):
    draw = np.random.default_rng(0)
    return [
        Result(i, k, None, np.array([1e6, 2e6]), {"success_sampled": draw.uniform(size=2)})
        for i in range(cells)
        for k in range(seeds)
    ]


def test_the_line_is_the_interquartile_mean_over_seeds_and_the_band_its_middle_half():
    found = _results(2, seeds=5)
    axes = figure(["a", "b"], found).axes[0]
    assert [line.get_label() for line in axes.lines] == ["a", "b"]
    for cell, (line, band) in enumerate(zip(axes.lines, axes.collections, strict=True)):
        curves = np.array([[0, *r.scores["success_sampled"]] for r in found if r.cell == cell])
        np.testing.assert_allclose(line.get_xdata(), [0, 1, 2])
        middle = np.sort(curves, axis=0)[1:4].mean(axis=0)  # of five, one off at each end
        np.testing.assert_allclose(line.get_ydata(), middle, rtol=1e-6)
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


def test_cells_beyond_the_colours_are_told_apart_by_their_lines():
    count = 2 * len(COLOURS) + 1
    axes = figure([f"cell {i}" for i in range(count)], _results(count)).axes[0]
    looks = [(line.get_color(), line.get_linestyle()) for line in axes.lines]
    assert len({*looks}) == len(looks) == count


def test_a_cell_without_results_is_left_out():
    axes = figure(["a", "not yet"], _results(1)).axes[0]
    assert [line.get_label() for line in axes.lines] == ["a"]


@pytest.mark.parametrize("cells", [1, 30])
def test_a_picture_is_written(tmp_path, cells):
    write_figure(tmp_path / "sweep.png", [f"cell {i}" for i in range(cells)], _results(cells, 1))
    assert (tmp_path / "sweep.png").read_bytes().startswith(b"\x89PNG")


def test_of_nothing_no_picture_is_written(tmp_path):
    write_figure(tmp_path / "sweep.png", ["a"], [])
    assert not (tmp_path / "sweep.png").exists()
