"""The tables of an ablation of soundness beside plain sums over their lines."""

import numpy as np

from gril_jax.workflows.study.results import Found
from gril_jax.workflows.study.soundness.soundness import COLUMNS, PREDICTORS, text
from gril_jax.workflows.study.written import column, mean_interval


def _lines(rows=4, seeds=6, policies=True):
    """Encoders of which the hack share tells the success, and tau nothing."""
    draw = np.random.default_rng(0)
    found = []
    for row in range(rows):
        for seed in range(seeds):
            values = draw.uniform(size=len(COLUMNS))
            line = {"row": f"row {row}", "seed": seed}
            line |= dict(zip(COLUMNS[2:], map(float, values), strict=False))
            line["success"] = 1.0 - line["hack_share_demo"]
            line |= {"starts": 8.0, "episodes": 8.0}
            if not policies:
                line = {k: v for k, v in line.items() if k in ("row", "seed", *PREDICTORS)}
            found.append(line)
    return found


def markdown(lines):
    return text(Found([], lines, [], {}, {}))


def test_a_row_has_mean_and_range_over_its_encoders():
    lines = _lines(2)
    rows = [x for x in markdown(lines).splitlines() if x.startswith("| row 1 |")]
    first, demo, demo_outbid, layout = rows[:4]
    assert first.startswith("| row 1 | 6 |")
    assert first.strip("| ").split(" | ")[3:5] == [
        mean_interval()(column(lines[6:], name), 6) for name in ("success", "success_sampled")
    ]
    for line, names in (
        (first[: first.index(" | 0.", 20)], ("tau",)),
        (demo, ("order_demo", "touch_demo", "push_demo", "hack_gap_demo")),
        (demo_outbid, ("outbid_demo",)),
        (layout, ("order_layout", "touch_layout", "push_layout", "hack_gap_layout")),
    ):
        for cell, name in zip(line.strip("| ").split(" | ")[-len(names) :], names, strict=True):
            x = column(lines[6:], name)
            assert cell == f"{x.mean():.3f} ({x.min():.3f} to {x.max():.3f})"


def test_an_undefined_share_is_counted_and_not_averaged():
    lines = _lines(1, 3)
    lines[0]["touch_layout"] = float("nan")
    x = column(lines[1:], "touch_layout")
    cell = f"{x.mean():.3f} ({x.min():.3f} to {x.max():.3f}; 1 undefined)"
    assert cell in markdown(lines)


def test_every_figure_has_its_correlation_with_success():
    table = markdown(_lines())
    for name in ("tau", "order, Demo starts", "hack gap, Layout starts"):
        assert f"\n| {name} | positive | " in table
    assert "| hack share, Demo starts | negative | -1.00 (-1.00 to -1.00) | 100 % |" in table
    assert table.splitlines()[-1] == (
        f"The best is hack share, Demo starts, better than tau in 100 % of the samples: "
        f"{_basis(_lines())}."
    )


def _basis(lines):
    x = column(lines, "success")
    few, most = (x < 0.05).sum(), (x > 0.95).sum()
    return f"{few} of {len(x)} encoders gave a success below 5 %, and {most} above 95 % (8 starts)"


def test_tau_may_be_the_best():
    lines = [line | {"success": line["tau"]} for line in _lines()]
    assert "No figure of the audit predicts success better than tau does" in markdown(lines)


def test_too_few_encoders_and_equal_ones_are_told():
    assert "20 encoders at least would be needed" in markdown(_lines(2))
    same = [line | {"success": 0.0} for line in _lines(5)]
    assert markdown(same).splitlines()[-1] == (
        "All encoders are the same in success, so nothing predicts it: 30 of 30 encoders gave a "
        "success below 5 %, and 0 above 95 % (8 starts)."
    )


def test_without_policies_there_is_no_success_to_tell():
    table = markdown(_lines(policies=False))
    assert "actions |" not in table
    assert "correlation" not in table
