"""The ladder of help: its rows, what it refuses, its matrices and its figure."""

import re

import numpy as np
import pytest

from gril_jax.cli.main import main
from gril_jax.config.files import load
from gril_jax.workflows.build.given import given
from gril_jax.workflows.study.counted import Counted
from gril_jax.workflows.study.curves import Curve
from gril_jax.workflows.study.ladder import rows
from gril_jax.workflows.study.ladder.ladder import TABLE
from gril_jax.workflows.study.results import Found
from gril_jax.workflows.study.rows import changed

STARTS = {"jitter": Counted(1024, 1024)}
NAMES = ["ours at level A", "ours at level V", "GraphIRL at level V"]


@pytest.mark.parametrize("task", ["match_regions", "shoes_in_box"])
def test_a_row_gives_the_learner_the_help_of_its_level(task):
    for row, change in rows.of_task(task).items():
        assert given(changed(load(task), change)).level == rows.parts(row)[1], row


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (["magical_suite"], "env.name is 'move_to_corner', but a ladder is made for match_regions"),
        (
            ["tabletop", "--env.name=umbrella_out", "--rows=ours at level V"],
            "--rows names 'ours at",
        ),
        (
            ["shoes_in_box", "--ppo.visited-state-resets=1"],
            "each row of the table sets it for itself",
        ),
        (["--run.algorithm", "sac"], "run.algorithm is 'sac', but must be 'ppo' for a ladder"),
        (["--ppo.visited-state-resets", "0.2"], "each row of the table sets it for itself"),
        (["--rows", "ours at level D"], "--rows names 'ours at level D' (did you mean ours at"),
    ],
)
def test_what_its_rows_are_not_for_is_refused(args, said, capsys):
    assert main(["ladder", *args]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def _found():
    """Two policies a row; the last row's second never gets to 80 %."""
    curves = []
    for cell, ends in enumerate([(0.0, 0.0), (0.9, 1.0), (0.25, 0.85)]):
        for seed, end in enumerate(ends):
            success = np.array([0.0, end / 2, end])
            scores = {name: success for name in ("success", "success_sampled", "success_ever")}
            scores["score"] = success
            steps = np.array([1e6, 2e6, 3e6])
            curves.append(Curve(cell, seed, None, steps, steps / 1e6, scores, STARTS))
    lines = [
        {"row": NAMES[curve.cell], "seed": curve.seed} | dict(TABLE.policy(curve))
        for curve in curves
    ]
    return Found(NAMES, lines, curves, {}, {})


def test_the_matrices_have_a_line_a_reward_and_a_column_a_level():
    text = TABLE.text(_found())
    tables = re.findall(r"(?:^\|.*\n?)+", text, re.MULTILINE)
    assert len(tables) == 3
    assert tables[0].splitlines() == [
        "| reward | level A | level V |",
        "|---|---|---|",
        "| ours | 0.0 (0.0 to 0.0) | 95.0 (90.0 to 100.0) |",
        "| GraphIRL |  | 55.0 (25.0 to 85.0) |",
    ]
    assert tables[2].splitlines()[2:] == [
        "| ours | never (0 of 2) | 3.00 (2 of 2) |",
        "| GraphIRL |  | never (1 of 2) |",
    ]
    assert "1024 Jitter starts" in text


def test_the_figure_has_a_panel_a_level_and_a_line_for_each_of_its_rewards():
    panels = TABLE.figure(_found()).axes
    assert [panel.get_title(loc="left") or panel.get_title() for panel in panels] == [
        "level A",
        "level V",
    ]
    assert [len(panel.lines) for panel in panels] == [1, 2]
    np.testing.assert_allclose(panels[1].lines[0].get_ydata(), [0, 0, 0.475, 0.95], atol=1e-6)


def test_nothing_that_has_finished_is_no_table_yet():
    empty = Found(NAMES, [], [], {}, {})
    assert TABLE.text(empty) == ""
    assert TABLE.figure(empty) is None
