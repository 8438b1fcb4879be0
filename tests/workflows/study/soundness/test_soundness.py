"""`gril soundness`: what it refuses, joined tables, and a whole run that was cut off."""

import csv
import dataclasses

import jax
import jax.numpy as jnp
import pytest
from support.kinematic_demos import kinematic_demos

from gril_jax import threads
from gril_jax.cli import main
from gril_jax.config import EnvConfig, PPOConfig, RunConfig
from gril_jax.demos.demo_set import DemoSet
from gril_jax.errors import ConfigError, RunError
from gril_jax.runs import run_dir
from gril_jax.workflows.build import demonstrations, setup
from gril_jax.workflows.study import frame, measures, results
from gril_jax.workflows.study.rows import read_settings, write_settings
from gril_jax.workflows.study.soundness.rows import ROWS, Settings
from gril_jax.workflows.study.soundness.soundness import COLUMNS, TABLE
from gril_jax.workflows.study.written import csv as written

SMALL = RunConfig(
    env=EnvConfig(targets=("green square",), distractors=("yellow circle",), episode_length=10),
    ppo=PPOConfig(num_envs=4, num_minibatches=2, unroll_length=5, num_timesteps=40, hidden=(8,)),
)


def _fault(capsys, *args):
    assert main.main(["soundness", *map(str, args)]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    return err


def _run(folder, rows, **changes):
    """A run's folder with a table, as far as joining looks at it."""
    run_dir.create(folder, dataclasses.replace(SMALL, **changes), device="cpu").close()
    write_settings(folder, "soundness", Settings({row: {"loss.touch": 0.0} for row in rows}))
    both = {"success": 1.0, "success_sampled": 0.5}
    lines = [
        {"row": row, "seed": k, "tau": 0.5} | {name: k * x for name, x in both.items()}
        for row in rows
        for k in (0, 1)
    ]
    (folder / "soundness.csv").write_text(written(lines, COLUMNS))
    return folder


def test_a_mistake_on_the_command_line_has_exit_code_2(tmp_path, capsys):
    for option in ("--seeds", "--policies-at-once", "--ascents", "--starts"):
        err = _fault(capsys, option, "0")
        assert f"{option} is '0', but must be a whole number of at least 1" in err
    assert "--steps-per-policy is 'x', but" in _fault(capsys, "--steps-per-policy", "x")
    assert "must cover one update" in _fault(capsys, "--steps-per-policy", "1")
    assert "--rows names 'none'" in _fault(capsys, "--rows", "none")
    assert "run.reward is 'environmental'" in _fault(capsys, "--reward", "environmental")
    assert "--seeds must not be given beside it" in _fault(
        capsys, "--resume", tmp_path, "--seeds", "2"
    )
    assert "has no config.yaml" in _fault(capsys, "--resume", tmp_path)
    assert "--out is missing" in _fault(capsys, "--join", tmp_path)
    assert "has no config.yaml" in _fault(capsys, "--join", tmp_path, "--out", tmp_path / "new")


def test_what_the_command_line_says_reaches_the_experiment(monkeypatch):
    calls = []
    monkeypatch.setattr(frame, "make", lambda _, *args, **kwargs: calls.append((args, kwargs)))
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "unused")
    args = ["--rows", "paper,copies", "--seeds", "3", "--steps-per-policy", "0", "--ascents", "7"]
    assert main.main(["soundness", "match_regions", *args]) == 0
    assert main.main(["soundness", "--steps-per-policy", "4000"]) == 0
    (first, second) = ((config, settings) for (config, settings), _ in calls)
    assert list(first[1].rows) == ["paper", "copies"]
    assert (first[1].seeds, first[1].policies, first[1].ascents) == (3, False, 7)
    assert first[0].demos.num == 128
    assert second[0].ppo.num_timesteps == 4000
    assert second[1] == Settings(ROWS)


def test_tables_of_runs_with_different_rows_become_one(tmp_path, capsys):
    folders = [_run(tmp_path / "a", ["x", "y"]), _run(tmp_path / "b", ["z"])]
    assert main.main(
        ["soundness", "--join", ",".join(map(str, folders)), "--out", str(tmp_path / "both")]
    ) == 0  # fmt: skip
    lines = list(csv.DictReader((tmp_path / "both" / "soundness.csv").open()))
    assert [(x["row"], x["seed"]) for x in lines] == [(r, k) for r in "xyz" for k in "01"]
    assert "| z | 2 | 0.500 (0.500 to 0.500) |" in (tmp_path / "both" / "soundness.md").read_text()
    assert (tmp_path / "both" / "soundness.png").stat().st_size > 10_000
    assert "over 6 encoders" in capsys.readouterr().out


def test_runs_that_do_not_belong_together_are_not_joined(tmp_path):
    first, out = _run(tmp_path / "a", ["x"]), tmp_path / "out"
    with pytest.raises(ConfigError, match="row 'x' with seed 0 is in two of the runs"):
        results.join(TABLE, [first, _run(tmp_path / "b", ["x"])], out)
    other = _run(tmp_path / "c", ["y"], ppo=PPOConfig())
    with pytest.raises(ConfigError, match=r"cannot be joined with .* ppo\.num_timesteps"):
        results.join(TABLE, [first, other], out)
    offset = dataclasses.replace(SMALL.run, reward_offset=0.5)
    with pytest.raises(ConfigError, match=r"run\.reward_offset \(0\.5, not 0\.0\)"):
        results.join(TABLE, [first, _run(tmp_path / "e", ["y"], run=offset)], out)
    (other / "soundness.csv").unlink()
    with pytest.raises(RunError, match="has no table yet"):
        results.join(TABLE, [_run(tmp_path / "d", ["y"], ppo=PPOConfig()), other], out)
    assert not out.exists()


@pytest.mark.slow
def test_a_run_that_was_cut_off_goes_on_where_it_stood(tmp_path, monkeypatch):
    monkeypatch.setattr(threads, "cores", lambda: 2)  # things are done in the rows' order
    batch = jax.tree.map(jnp.asarray, kinematic_demos(0, 4, num_objects=4))

    class Same(demonstrations.Demonstrations):
        def batch(self, split):
            return batch

    classes = setup.make_env(SMALL.env, training=False).classes
    demos = Same(DemoSet((), "match_regions", tuple(classes), 1.0, 20.0, ""), {}, 0)
    monkeypatch.setattr(frame.demonstrations, "gather_once", lambda *args: demos)
    out = tmp_path / "run"
    options = [
        "--rows", "paper,touched", "--seeds", "2", "--steps-per-policy", "40", "--ascents", "4",
        "--starts", "1", "--pretrain.steps", "2", "--pretrain.num-videos", "3",
        "--env.episode-length", "10", "--env.varied-starts", "0",
        "--ppo.num-envs", "4", "--ppo.num-minibatches", "2", "--ppo.unroll-length", "5",
        "--ppo.hidden", "8", "--run.evaluations", "1", "--out", str(out),
    ]  # fmt: skip
    with monkeypatch.context() as cut:
        stop = lambda *args: (_ for _ in ()).throw(KeyboardInterrupt)  # noqa: E731
        cut.setattr(frame, "learn_policies", stop)
        assert main.main(["soundness", "quickstart", *options]) == 130
    audited = list(csv.DictReader((out / "soundness.csv").open()))
    assert [x["success"] for x in audited] == [""] * 4
    assert list(read_settings(out, "soundness", Settings).rows) == ["paper", "touched"]
    assert not (out / "soundness.png").exists()

    monkeypatch.setattr(measures, "audit_figures", None)  # not done again
    assert main.main(["soundness", "--resume", str(out)]) == 0
    lines = list(csv.DictReader((out / "soundness.csv").open()))
    assert [(x["row"], x["seed"]) for x in lines] == [
        (row, seed) for row in ("paper", "touched") for seed in "01"
    ]
    for before, after in zip(audited, lines, strict=True):
        assert 0 <= float(after["success"]) <= 1
        assert after["env_steps"] == "40"
        for name in ("tau", "order_demo", "hack_gap_layout"):
            assert before[name] == after[name] != ""
    assert run_dir.read_results(out) == {"encoders": 4, "policies": 4, "programs": 1}
    assert (out / "soundness.png").stat().st_size > 10_000
