"""An addition, a file and a line of a table, is found by the command line."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from support import dummies

from gril_jax.demos.demo_set import load_demo_set
from gril_jax.runs.checkpoints import checkpoint


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The folder of a run of all of them, evaluated; one start of Python for all."""
    folder = tmp_path_factory.mktemp("dummies")
    command = [sys.executable, dummies.__file__, str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ)
    assert done.returncode == 0, done.stderr[-2000:]
    return folder / "run"


def _rows(run, phase):
    lines = (run / "metrics.jsonl").read_text().splitlines()
    return [row for row in map(json.loads, lines) if row["phase"] == phase]


def test_a_task_is_a_folder_a_line_and_a_yaml_file(run):
    assert (run / "report.html").is_file()
    demos = load_demo_set(run / "demos")
    assert (demos.task, demos.classes) == ("reach", ("goal", "robot"))
    assert [e.outcome for e in demos] == ["success"] * 6 + ["failure"]


def test_an_encoder_is_a_file_and_a_line(run):
    leaves = checkpoint.manifest(checkpoint.latest(run / "reward"))["leaves"]
    kernel = next(leaf for leaf in leaves if "dummy_kernel" in leaf["path"])
    assert kernel["shape"] == [4, 3]


def test_a_loss_is_a_file_and_a_line(run):
    assert {row["consistency"] for row in _rows(run, "pretrain")} == {7.0}


def test_a_form_of_the_reward_is_a_file_and_a_line(run):
    assert {row["reward"] for row in _rows(run, "dummy")} == {5.0}


def test_an_algorithm_is_a_file_and_a_line_and_has_a_section_of_its_name(run):
    assert {row["dummy"] for row in _rows(run, "dummy")} == {3.0}
    assert "\ndummy:\n  num_timesteps: 20\n" in (run / "config.yaml").read_text()
    with np.load(run / "rollouts.npz") as played:
        assert played.files
