"""Table III: its rows, what it refuses, its matrices and its figure."""

import numpy as np
import pytest
from gril_jax.envs import registry

from gril_jax.cli.main import main
from gril_jax.config.files import load
from gril_jax.workflows.study.counted import Counted
from gril_jax.workflows.study.curves import Curve
from gril_jax.workflows.study.results import Found
from gril_jax.workflows.study.table3 import rows
from gril_jax.workflows.study.table3.table3 import TABLE

STARTS = {"": Counted(64, 64)}


def test_ours_is_the_configuration_of_the_tasks():
    chosen = {name: rows.ROWS[name] for name in rows.ROWS if name.startswith("ours on")}
    found = rows.configs(load("tabletop"), rows.Settings(chosen))
    assert [config.env.name for config in found] == [*rows.TASKS]
    for config in found:
        usual = load("tabletop", ["--env.name", config.env.name])
        for part in ("encoder", "pool", "loss", "pretrain", "run", "ppo"):
            assert getattr(config, part) == getattr(usual, part), part


def test_each_task_has_the_rewards_that_rows_ask_for():
    for task in rows.TASKS:
        assert {"staged", "sparse"} <= {*registry.spec(task).rewards}


def test_a_row_takes_its_own_task_s_set():
    chosen = {"ours on umbrella_out": rows.ROWS["ours on umbrella_out"]}
    config = rows.with_sets(load("tabletop"), "sets")
    assert rows.configs(config, rows.Settings(chosen))[0].demos.path == "sets/umbrella_out"


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (["--env.name", "umbrella_out"], "each row of the table sets it for itself"),
        (["--run.algorithm", "sac"], "run.algorithm is 'sac', but must be 'ppo' here"),
        (["--rows", "ours on a_shelf"], "--rows names 'ours on a_shelf'"),
        (["--sets", "."], "has no set rubbish_in_bin, but must hold one for each task"),
    ],
)
def test_what_its_rows_are_not_for_is_refused(args, said, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["table3", *args]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def _found():
    names = ["ours on umbrella_out", "GraphIRL on umbrella_out", "ours on rubbish_in_bin"]
    curves = []
    for cell, ends in enumerate([(0.9, 1.0), (0.25, 0.85), (0.0, 0.5)]):
        for seed, end in enumerate(ends):
            success = np.array([0.0, end])
            scores = {
                name: success for name in ("success", "success_sampled", "success_ever", "score")
            }
            curves.append(Curve(cell, seed, None, np.array([1e6, 2e6]), np.ones(2), scores, STARTS))
    lines = [
        {"row": names[curve.cell], "seed": curve.seed} | dict(TABLE.policy(curve))
        for curve in curves
    ]
    return Found(names, lines, curves, {}, {})


def test_the_matrix_has_a_line_a_reward_and_a_column_a_task():
    table = TABLE.text(_found()).split("\n\n")[1]
    assert table.splitlines() == [
        "| reward | rubbish_in_bin | umbrella_out |",
        "|---|---|---|",
        "| ours | 25.0 (0.0 to 50.0) | 95.0 (90.0 to 100.0) |",
        "| GraphIRL |  | 55.0 (25.0 to 85.0) |",
    ]


def test_the_figure_has_a_panel_a_task():
    panels = TABLE.figure(_found()).axes
    assert [panel.get_title(loc="left") or panel.get_title() for panel in panels] == [
        "rubbish_in_bin", "umbrella_out",
    ]  # fmt: skip
    assert [len(panel.lines) for panel in panels] == [1, 2]
