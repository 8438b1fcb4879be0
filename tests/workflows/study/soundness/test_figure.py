"""The figure of an ablation of soundness: every encoder with a policy is a dot in each panel."""

import numpy as np
import pytest

from gril_jax.errors import ShapeError
from gril_jax.report.figures.style import png
from gril_jax.workflows.study.soundness.soundness import figure

NAMES = ("tau", "order_demo", "touch_demo", "hack_gap_demo")


def _lines(rows):
    draw = np.random.default_rng(0)
    return [
        {"row": f"row {row}", "seed": seed, "success_sampled": float(draw.uniform())}
        | {name: float(draw.uniform()) for name in NAMES}
        for row in range(rows)
        for seed in range(2)
    ]


def test_a_panel_shows_each_row_at_its_numbers():
    lines = [*_lines(8), {"row": "no policy yet", "seed": 0, "tau": 0.5}]
    panels = figure(lines).axes
    assert len(panels) == len(NAMES)
    for axes, name in zip(panels, NAMES, strict=True):
        assert [dots.get_label() for dots in axes.lines] == [f"row {row}" for row in range(8)]
        for row, dots in enumerate(axes.lines):
            members = lines[2 * row : 2 * row + 2]
            np.testing.assert_array_equal(dots.get_xdata(), [line[name] for line in members])
            np.testing.assert_array_equal(
                dots.get_ydata(), [line["success_sampled"] for line in members]
            )
        looks = [(dots.get_color(), dots.get_marker()) for dots in axes.lines]
        assert len({*looks}) == len(looks)


def test_an_undefined_share_does_not_stop_it():
    lines = _lines(2)
    lines[0]["touch_demo"] = float("nan")
    assert png(figure(lines)).startswith(b"\x89PNG")


def test_without_policies_there_is_no_figure():
    with pytest.raises(ShapeError, match="at least one encoder must have a policy"):
        figure([{"row": "a", "seed": 0, "tau": 0.5}])
