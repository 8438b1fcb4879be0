"""Files of the version before the tree had rooms: each still loads, and means what it meant.

`tests/data/before_the_move` holds a run of `gril train quickstart` made as small as can be, with
its demonstrations, the two files exported from it, and numbers that the old version gave for them.
"""

import json
import shutil

import jax.numpy as jnp
import numpy as np
import pytest
from support.paths import TESTS

from gril_jax.cli import main
from gril_jax.demos.demo_set import demo_batch, load_demo_set
from gril_jax.export.read_policy import load_policy
from gril_jax.export.reward_file import load_reward
from gril_jax.runs import run_dir
from gril_jax.runs.checkpoints import state_leaves
from gril_jax.workflows.build import policy_setup, setup

DATA = TESTS / "data" / "before_the_move"
RECORDED = json.loads((DATA / "recorded.json").read_text())


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("older")
    shutil.unpack_archive(DATA / "run.zip", folder)
    return folder / "run"


@pytest.fixture(scope="module")
def task(run):
    """The run's configuration and its environment."""
    config = run_dir.read_config(run)
    return config, setup.make_env(config.env, training=False)


def test_a_reward_file_gives_the_same_value():
    learned = load_reward(DATA / "reward.npz")
    assert learned.objects == ("goal", "robot", "green square", "yellow circle")
    center = jnp.stack([jnp.linspace(-0.5, 0.5, 4), jnp.linspace(0.4, -0.3, 4)], axis=1)
    value = learned(center, jnp.full((4, 2), 0.2), jnp.arange(4) % 2 == 1)
    assert float(value) == pytest.approx(RECORDED["reward"], rel=1e-5)


def test_a_policy_file_acts_as_it_did_and_as_a_new_one_does(run, tmp_path):
    out = ["--out", str(tmp_path / "new.npz")]
    assert main.main(["export", "--what", "policy", str(run), *out]) == 0
    for file in (DATA / "policy.npz", tmp_path / "new.npz"):
        act = load_policy(file)
        with np.load(file) as arrays:
            size = len(arrays["observation_mean"])
        action = act(np.linspace(-1, 1, size))
        np.testing.assert_allclose(action, RECORDED["action"], rtol=1e-5)


def test_a_demonstration_set_still_passes_its_checks(run):
    demos = load_demo_set(run / "demos")
    assert len(demos.entries) == 6
    assert [entry.outcome for entry in demos.entries] == ["success"] * 5 + ["failure"]
    assert demo_batch(demos).center.shape[0] == 6


def test_checkpoints_of_reward_and_policy_are_restored_bit_for_bit(run, task):
    config, env = task
    learned = policy_setup.learned_reward(run, config, env)
    assert state_leaves.digest(learned) == RECORDED["reward_sha256"]
    assert state_leaves.digest(learned) == run_dir.read_results(run)["reward_sha256"]
    algorithm = policy_setup.make_algorithm(config, env)
    policy = policy_setup.restore_policy(run, config, algorithm)
    assert state_leaves.digest(policy) == RECORDED["policy_sha256"]


def test_a_run_is_evaluated_to_the_same_reward(run, capsys):
    assert main.main(["eval", str(run), "--episodes", "4", "--variant", "demo"]) == 0
    *rates, numbers = capsys.readouterr().out.splitlines()
    assert float(numbers.split()[3]) == pytest.approx(RECORDED["mean_reward"], abs=2e-4)
    assert rates[0] == "success with deterministic actions: not solved (one Demo start)"


def test_a_run_s_report_is_drawn_again(run):
    assert main.main(["report", str(run)]) == 0
    page = (run / "report.html").read_text(encoding="utf-8")
    assert "gril train quickstart" in page
    assert "number of starts not recorded" in page
