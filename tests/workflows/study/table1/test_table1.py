"""`gril table1`: what it refuses, what reaches the experiment, and a whole run that was cut off."""

import csv
import json

import jax.numpy as jnp
import pytest

from gril_jax import threads
from gril_jax.cli import main
from gril_jax.config.files import load, to_yaml
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.runs import run_dir
from gril_jax.runs.phases import Phases, write_phases
from gril_jax.workflows.build import policy_rewards
from gril_jax.workflows.study import frame, measures
from gril_jax.workflows.study.rows import changed, write_settings
from gril_jax.workflows.study.table1.columns import COLUMNS
from gril_jax.workflows.study.table1.rows import ROWS, Settings


def _fault(capsys, *args):
    assert main.main(["table1", *map(str, args)]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    return err


def _demos(folder, task, count):
    folder.mkdir()
    demos = [{"outcome": "success"}] * count
    (folder / "demos.json").write_text(json.dumps({"task": task, "demos": demos}))
    return folder


def test_a_mistake_on_the_command_line_has_exit_code_2(tmp_path, capsys):
    for option in ("--seeds", "--steps-per-encoder", "--ascents", "--starts"):
        err = _fault(capsys, option, "0")
        assert f"{option} is '0', but must be a whole number of at least 1" in err
    assert "'enviromental' (did you mean environmental?)" in _fault(
        capsys, "--rows", "enviromental"
    )
    assert "--run.reward is given, but each row of the table sets it" in _fault(
        capsys, "--reward", "learned"
    )
    assert "--loss.lambda is given, but" in _fault(capsys, "--lambda=0.1")
    assert "--seeds must not be given beside it" in _fault(
        capsys, "--resume", tmp_path, "--seeds", "2"
    )
    assert "has no config.yaml" in _fault(capsys, "--resume", tmp_path)
    assert "must be a task with the rewards S4, V5, sparse, which the rows set" in _fault(
        capsys, "shoes_in_box"
    )


def test_unfit_demonstrations_are_refused_before_work_starts(tmp_path, capsys):
    other = _demos(tmp_path / "other", "shoes_in_box", 40)
    assert "holds demonstrations of 'shoes_in_box', but" in _fault(capsys, "--demos", other)
    few = _demos(tmp_path / "few", "match_regions", 8)
    assert "but a batch needs 8" in _fault(capsys, "--demos", few)


def test_what_the_command_line_says_reaches_the_experiment(monkeypatch):
    calls = []
    monkeypatch.setattr(frame, "make", lambda table, *args, **kwargs: calls.append(args))
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "unused")
    assert main.main(["table1"]) == 0
    assert main.main(["table1", "--quick", "--algorithm", "sac"]) == 0
    some = ["--rows", "sparse score,XIRL", "--seeds", "3", "--run.evaluations", "4"]
    assert main.main(["table1", *some]) == 0
    usual, quick, chosen = calls
    assert usual == (changed(load("match_regions"), {"run.evaluations": 10}), Settings(ROWS))
    assert list(quick[1].rows) == ["environmental", "ours without robot"]
    assert quick[1].rows["ours without robot"]["pretrain.steps"] == 1500
    assert (quick[1].seeds, quick[0].run.algorithm) == (2, "sac")
    assert quick[0].ppo == load("quickstart").ppo
    assert (list(chosen[1].rows), chosen[1].seeds) == (["sparse score", "XIRL"], 3)
    assert chosen[0].run.evaluations == 4


@pytest.mark.parametrize(("algorithm", "discount"), [("ppo", 0.975), ("sac", 0.9)])
def test_the_shaped_reward_has_the_weights_of_its_row_and_the_discount_of_the_learner(
    algorithm, discount
):
    shaped = ROWS["ours with potential shaping"] | {"run.algorithm": algorithm}
    config = changed(load("quickstart"), shaped | {"sac.discounting": 0.9})
    learned = RewardParams({}, jnp.zeros(2), jnp.ones(()), jnp.ones(()))
    weights, found, own = policy_rewards.parameters(config, learned, None, 4)
    assert (weights.tolist(), float(found)) == ([10.0, 1.0], pytest.approx(discount))
    assert own is learned


def _run(folder, row, seed=0, demos="abc", evaluations=2, tau=None):
    """A finished run of one row, as far as its table needs it."""
    folder.mkdir()
    config = changed(load("quickstart"), {"run.out": str(folder), "run.evaluations": evaluations})
    (folder / "config.yaml").write_text(to_yaml(config))
    write_settings(folder, "table1", Settings({row: ROWS[row]}, seeds=1))
    done = {"rows": [(0, seed)], "taus": [tau], "seconds": 2.0}
    finished = {"demos": {"sha256": demos}, "policy-0": done}
    if tau is not None:
        finished["audit-0"] = {"order_demo": [0.9], "hack_gap_demo": [None]}
        finished["profiles-0"] = {"cycle": [0.8], "success": [[-1.0, 0.0]], "failure": []}
    write_phases(folder, Phases("table1", to_yaml(config), finished))
    numbers = {name: [0.25] for name in COLUMNS[2:14]}
    rows = [{"phase": "policy-0", "env_steps": n, "seconds": n, **numbers} for n in (10, 20)]
    (folder / "metrics.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    (folder / "versions.json").write_text(json.dumps({"command": f"gril table1 {row}"}))
    return folder


def test_runs_with_different_rows_become_one_table(tmp_path, capsys):
    learned = _run(tmp_path / "a", "ours audited", tau=0.7)
    other = _run(tmp_path / "b", "environmental")
    out = tmp_path / "out"
    assert main.main(["table1", "--join", f"{learned},{other}", "--out", str(out)]) == 0
    lines = list(csv.DictReader((out / "table1.csv").open()))
    assert [x["row"] for x in lines] == ["environmental", "ours audited"]
    assert [(x["tau"], x["order_demo"], x["hack_gap_demo"], x["cycle"]) for x in lines] == [
        ("", "", "", ""),
        ("0.7", "0.9", "", "0.8"),
    ]
    assert {x["success"] for x in lines} == {"0.25"}
    text = (out / "table1.md").read_text()
    assert "gril table1 ours audited and gril table1 environmental" in text
    capsys.readouterr()
    assert "must be a new folder" in _fault(capsys, "--join", learned, "--out", out)


def test_runs_that_do_not_go_together_are_not_joined(tmp_path, capsys):
    first, out = _run(tmp_path / "a", "environmental"), tmp_path / "out"
    for name, fault, other in (
        ("b", "they differ in the demonstrations", {"row": "sparse score", "demos": "x"}),
        ("c", "they differ in run.evaluations (3, not 2)", {"row": "XIRL", "evaluations": 3}),
        ("d", "row 'environmental' with seed 0 is in two of the runs", {"row": "environmental"}),
    ):
        folder = _run(tmp_path / name, **other)
        assert main.main(["table1", "--join", f"{first},{folder}", "--out", str(out)]) == 2
        assert fault in capsys.readouterr().err
        assert not out.exists()
    assert "--out is missing" in _fault(capsys, "--join", f"{first},{first}")


TINY = [
    "--rows", "environmental,ours audited,ours with potential shaping", "--seeds", "2",
    "--steps-per-encoder", "2", "--ascents", "4", "--starts", "1", "--demos.num", "6",
    "--demos.num-validation", "2", "--demos.num-failures", "1", "--pretrain.num-videos", "3",
    "--pretrain.num-frames", "6", "--env.varied-starts", "0", "--ppo.num-envs", "8",
    "--ppo.num-minibatches", "2", "--ppo.num-timesteps", "960", "--ppo.hidden", "8",
    "--run.evaluations", "4", "--encoder.rounds", "1",
]  # fmt: skip


@pytest.mark.slow
def test_a_run_that_was_cut_off_goes_on_where_it_stood(tmp_path, monkeypatch):
    monkeypatch.setattr(threads, "cores", lambda: 2)  # things are done in the rows' order
    out = tmp_path / "run"
    learn, done = frame.learn_policies, []

    def twice(*args):
        if len(done) == 2:
            raise KeyboardInterrupt
        done.append(args[0].name)
        return learn(*args)

    with monkeypatch.context() as cut:
        cut.setattr(frame, "learn_policies", twice)
        assert main.main(["table1", "quickstart", *TINY, "--out", str(out)]) == 130
    first = list(csv.DictReader((out / "table1.csv").open()))
    assert [x["row"] for x in first if x["success"]] == ["environmental"] * 2 + ["ours audited"] * 2

    monkeypatch.setattr(measures, "audit_figures", None)  # not done again
    assert main.main(["table1", "--resume", str(out)]) == 0
    lines = list(csv.DictReader((out / "table1.csv").open()))
    assert lines[:4] == first[:4]
    assert [(x["row"], x["seed"]) for x in lines] == [
        (row, seed)
        for row in ("environmental", "ours audited", "ours with potential shaping")
        for seed in "01"
    ]
    for line in lines:
        assert float(line["env_steps"]) == 960
        assert 0 <= float(line["success_layout_sampled"]) <= 1
        assert (line["tau"] == "") == (line["row"] == "environmental")
    for audited, shaped in zip(lines[2:4], lines[4:], strict=True):  # they share their encoders
        for name in ("tau", "cycle", "order_demo", "hack_gap_demo"):
            assert audited[name] == shaped[name] != ""
    results = run_dir.read_results(out)
    assert (results["policies"], results["programs"]) == (6, 3)
    assert len(results["demos_sha256"]) == 64
    assert {"command", "device", "started", "packages"} < {*results}
    for name in ("table1.md", "figure2.png", "report.html"):
        assert (out / name).stat().st_size > 1000


@pytest.mark.slow
def test_quick_ends_with_both_rows(tmp_path):
    out = tmp_path / "run"
    assert main.main(["table1", "--quick", "--out", str(out)]) == 0
    rows = run_dir.read_results(out)["rows"]
    assert list(rows) == ["environmental", "ours without robot"]
    lines = list(csv.DictReader((out / "table1.csv").open()))
    assert len(lines) == 4
    assert all(float(line["tau"]) > 0.3 for line in lines[2:])  # two seeds say nothing of success
