"""A sweep from the command line to its table, and one that goes on after being cut off."""

import csv
import itertools
import json

import numpy as np
import pytest

from gril_jax.cli import main
from gril_jax.config.files import load
from gril_jax.config.grid import Cell
from gril_jax.errors import RunError
from gril_jax.runs import run_dir
from gril_jax.workflows.study import frame
from gril_jax.workflows.study.results import Found
from gril_jax.workflows.study.rows import changed

SMALL = [
    "--reward", "environmental", "--lambda", "0.5,1", "--ppo.discounting", "0.9,0.99",
    "--seeds", "2", "--ppo.num-envs", "4", "--ppo.num-minibatches", "2",
    "--ppo.unroll-length", "5", "--ppo.num-timesteps", "60", "--ppo.hidden", "8",
    "--env.episode-length", "10", "--run.evaluations", "2", "--run.checkpoint-every", "0",
]  # fmt: skip


def test_a_folder_that_is_no_sweep_is_refused(tmp_path):
    from gril_jax.workflows.study.sweeps.sweep import read_cells

    with pytest.raises(RunError, match="is not a sweep"):
        read_cells(tmp_path)


def test_an_odd_number_of_environments_is_refused_before_work_starts(tmp_path, capsys):
    odd = ["--seeds", "1", "--reward", "environmental", "--ppo.num-envs", "3"]
    odd += ["--ppo.num-minibatches", "1", "--out", str(tmp_path / "odd")]
    assert main.main(["sweep", "quickstart", *odd]) == 2
    assert "ppo.num_envs is 3, but must be even" in capsys.readouterr().err
    assert not (tmp_path / "odd").exists()


def test_rows_of_table_1_are_one_more_axis(monkeypatch):
    from gril_jax.workflows.study.table1 import rows as table1_rows

    calls = []
    monkeypatch.setattr(frame, "make", lambda table, *args, **kwargs: calls.append(args))
    rows = ["environmental", "ours with robot"]
    axis = ["--ppo.learning-rate", "1e-3,2e-3"]
    assert main.main(["sweep", "match_regions", "--rows", ",".join(rows), *axis]) == 0
    ((config, made),) = calls
    found = made.cells
    assert made.seeds == 5
    rates = (1e-3, 2e-3)
    assert [(cell.name, cell.config.ppo.learning_rate) for cell in found] == [
        (f"row {row}, learning-rate {rate}", float(rate))
        for row in rows
        for rate in axis[1].split(",")
    ]
    for cell, (row, rate) in zip(found, itertools.product(rows, rates), strict=True):
        plain = changed(config, table1_rows.ROWS[row])
        assert cell.config == changed(plain, {"ppo.learning_rate": rate})


def test_what_a_row_says_is_no_option_beside_it(capsys):
    for more, fault in (
        (["--rows", "environmental", "--reward", "learned,sum"], "--run.reward is given, but each"),
        (["--rows", "enviromental"], "did you mean environmental?"),
        (
            ["shoes_in_box", "--rows", "environmental"],
            "must be a task with the rewards S4, V5",
        ),
    ):
        assert main.main(["sweep", *more]) == 2
        assert fault in capsys.readouterr().err


@pytest.mark.slow
def test_a_sweep_without_evaluations_in_between_has_one_at_its_end(tmp_path):
    out = tmp_path / "once"
    few = [*SMALL, "--run.evaluations", "0"]
    assert main.main(["sweep", "quickstart", *few, "--out", str(out)]) == 0
    assert len([r for r in run_dir.read_metrics(out) if r["phase"] == "policy-0"]) == 1


def test_audited_rewards_are_sound_or_not_and_the_page_says_how_many():
    from gril_jax.workflows.study.sweeps import page, sweep

    sound = {"order": 0.99, "hack_gap": 0.1, "touch": 0.01, "push": 0.5}
    faulty = sound | {"touch": 0.06}
    lines = [
        {"row": "a cell", "seed": seed, "success": 0.9, "success_sampled": 0.95,
         "starts": 256, "episodes": 256}
        | {f"{name}_own": value for name, value in numbers.items()}
        for seed, numbers in enumerate((sound, faulty))
    ]  # fmt: skip
    lines = [line | sweep._sound(line) for line in lines]
    assert [line["sound"] for line in lines] == [1, 0]
    assert sweep._sound({"row": "a cell", "seed": 0}) == {}
    found = Found(["a cell"], lines, [], {}, {})
    assert page._tiles(found, {"a cell": np.array([0.9, 0.8])}, "256 starts") == [
        ("85.0%", "a cell", "80.0% to 90.0% over 2 policies, 256 starts"),
        ("1 of 2 sound", "the rewards, by their audit", ""),
    ]
    assert "1 of 2" in sweep.TABLE.text(found)


def test_rewards_of_one_task_are_audited_where_it_is_asked_for():
    from gril_jax.workflows.study.sweeps import sweep

    config = load("quickstart", ["--env.engine", "impulse"])
    cell = Cell((), config)
    (one,) = sweep._measures(config, sweep.Sweep([cell], 1), None)
    assert one.name == "audit"
    for other in ({"run.audit": 0}, {"run.reward": "environmental"}):
        assert (
            sweep._measures(config, sweep.Sweep([Cell((), changed(config, other))], 1), None) == []
        )
    two = [cell, Cell((), changed(config, {"env.targets": ("red star",)}))]
    assert sweep._measures(config, sweep.Sweep(two, 1), None) == []


@pytest.mark.slow
def test_a_sweep_makes_what_differs_once_and_goes_on_where_it_was_cut_off(tmp_path, monkeypatch):
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    assert main.main(["sweep", "quickstart", *SMALL, "--out", str(whole)]) == 0
    lines = list(csv.DictReader((whole / "sweep.csv").open()))
    assert len(lines) == 8  # lambda does not matter to this reward, but has its lines
    assert run_dir.read_results(whole)["policies"] == 4
    assert (whole / "sweep.png").stat().st_size > 10_000
    page = (whole / "report.html").read_bytes()
    (whole / "report.html").unlink()
    assert main.main(["report", str(whole)]) == 0
    assert (whole / "report.html").read_bytes() == page
    assert b"not audited" in page  # nothing has been learned here

    from gril_jax.runs import loop

    once = []

    def fail_after_first(self, done, state):
        original(self, done, state)
        once.append(done)
        raise KeyboardInterrupt

    original = loop.CheckpointWriter.save
    monkeypatch.setattr(loop.CheckpointWriter, "save", fail_after_first)
    assert main.main(["sweep", "quickstart", *SMALL, "--out", str(cut)]) == 130
    monkeypatch.undo()
    assert once == [1]
    assert main.main(["sweep", "--resume", str(cut)]) == 0
    assert (cut / "sweep.csv").read_text() == (whole / "sweep.csv").read_text()
    assert json.loads((cut / "sweep.json").read_text())["seeds"] == 2
