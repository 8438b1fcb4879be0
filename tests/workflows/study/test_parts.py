"""A study in parts: how work is shared out, and what processes that die or stop leave."""

import csv
import os
import signal
import subprocess
import sys
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import new_task
from support.tiny_runs import command

from gril_jax.config import RunConfig
from gril_jax.errors import ConfigError
from gril_jax.workflows.study import parts, recipe, saved
from gril_jax.workflows.study.recipe import changed
from gril_jax.workflows.study.saved import Plan

ALPHAS = st.lists(
    st.tuples(st.sampled_from([None, 1.0, 2.0, 3.0]), st.integers(1, 4)), min_size=1, max_size=6
)


def _plan(rows):
    """Rows without a reward, or with one of an alpha, each with so many seeds."""
    configs = {
        f"row {i}": changed(
            RunConfig(),
            {"run.reward": "environmental"} if alpha is None else {"pool.alpha": alpha},
        )
        for i, (alpha, _) in enumerate(rows)
    }
    work = {f"row {i}": [*range(seeds)] for i, (_, seeds) in enumerate(rows)}
    return Plan(recipe.Study("mine"), RunConfig(), configs, work)


@given(ALPHAS, st.integers(1, 8))
def test_each_run_is_in_one_part_and_parts_are_as_many_as_can_be(rows, count):
    plan = _plan(rows)
    found = parts.split(plan, count)
    each = [(name, seed) for part in found for name, seeds in part.items() for seed in seeds]
    wanted = [(name, seed) for name, seeds in plan.work.items() for seed in seeds]
    assert sorted(each) == sorted(wanted)
    assert len(found) == min(count, len(wanted))
    assert all(found)


def test_rows_with_the_same_reward_stay_together_where_there_is_enough_else():
    plan = _plan([(1.0, 1), (2.0, 1), (1.0, 1), (2.0, 1)])
    found = [{*part} for part in parts.split(plan, 2)]
    assert {"row 0", "row 2"} in found
    assert {"row 1", "row 3"} in found


def test_rows_that_are_not_to_be_made_need_no_part():
    plan = _plan([(None, 1), (1.0, 2), (2.0, 1)])
    assert parts.split(plan._replace(work={"row 1": [0, 1]}), 2) == [{"row 1": [0]}, {"row 1": [1]}]


def test_options_of_jobs_are_pairs(monkeypatch):
    monkeypatch.setattr(parts.importlib.util, "find_spec", lambda name: True)
    assert callable(parts.on_a_cluster("slurm", "slurm_partition=gpu,timeout_min=60", print))
    with pytest.raises(ConfigError, match="KEY=VALUE"):
        parts.on_a_cluster("slurm", "gpu", print)


# --- processes


@pytest.fixture(scope="module")
def task(tmp_path_factory):
    folder = tmp_path_factory.mktemp("task")
    new_task.write(folder, new_task.AUDITED)
    return folder


@pytest.fixture
def gril(task, tmp_path, monkeypatch):
    """Starts a command line in a folder, in a process that finds the task, as this one does."""
    monkeypatch.syspath_prepend(task)
    environment = os.environ | {"PYTHONPATH": str(task), "JAX_PLATFORMS": "cpu"}

    def start(*args):
        line = [sys.executable, "-m", "gril_jax.cli.main", *args]
        with open(tmp_path / "said", "w") as said:
            return subprocess.Popen(line, cwd=tmp_path, env=environment, stdout=said, stderr=said)

    return start


def _lines(folder):
    return list(csv.DictReader((folder / "study.csv").open()))


@pytest.mark.slow
def test_two_processes_make_what_one_makes_and_more_rows_may_follow(gril, tmp_path):
    sweep = [x if x != "run" else "whole" for x in command("sweep")]
    assert gril(*sweep).wait() == 0
    assert gril(*command("sweep"), "--devices", "2").wait() == 0
    assert len(saved.parts(tmp_path / "run")) == 2
    whole, apart = _lines(tmp_path / "whole"), _lines(tmp_path / "run")
    assert len(whole) == 4
    assert apart == whole
    for folder in ("whole", "run"):
        assert gril("sweep", "--resume", folder, "--seeds", "3").wait() == 0
        more = _lines(tmp_path / folder)
        assert len(more) == 6
        assert [line for line in more if line["seed"] != "2"] == whole
    assert (tmp_path / "run" / "report.html").stat().st_size > 10_000


@pytest.mark.slow
def test_parts_stop_with_their_parent_and_one_that_dies_fails_its_rows_alone(gril, tmp_path):
    parent = gril(*command("sweep"), "--devices", "2", "--ppo.num-timesteps", "64000",
                  "--run.evaluations", "200")  # fmt: skip
    run = tmp_path / "run"
    while parent.poll() is None and not [*run.glob("parts/*/checkpoints/policy-0/*")]:
        time.sleep(0.1)
    parent.send_signal(signal.SIGTERM)
    assert parent.wait() == 143
    assert "gril sweep --resume run goes on with it" in (tmp_path / "said").read_text()
    dead = next(part for part in saved.left(run))
    (dead / "metrics.jsonl").write_text("damaged")
    assert gril("sweep", "--resume", "run").wait() == 1
    said = (tmp_path / "said").read_text()
    assert "metrics.jsonl" in said
    (failed,) = {*saved.read(dead).work}
    assert {line["row"] for line in _lines(run) if line["env_steps"]} == {*saved.read(run).work} - {
        failed
    }
    assert f"alone: gril train {run.name}/rows/" in said


@pytest.mark.slow
def test_parts_are_jobs_of_a_cluster(gril, tmp_path):
    pytest.importorskip("submitit", reason="submitit is not installed: gril-jax[cluster]")
    assert gril(*command("sweep"), "--cluster", "local", "--devices", "2").wait() == 0
    assert len(_lines(tmp_path / "run")) == 4
