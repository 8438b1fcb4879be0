"""The functions of the front door: from a set of demonstrations to a policy, in Python alone."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import own_task

import gril_jax as gril
from gril_jax.cli import main
from gril_jax.errors import ConfigError, DemoError, RunError
from gril_jax.export.read_policy import load_policy
from gril_jax.rl.evaluate import begin, evaluate

QUIET = {"progress": False}


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """A task of a user's, its demonstrations, and a small configuration."""
    folder = tmp_path_factory.mktemp("home")
    own_task.write(folder)
    own_task.demonstrations(folder / "set")
    return folder


@pytest.fixture(scope="module")
def demos(home):
    return gril.load_demos(home / "set")


@pytest.fixture(scope="module")
def task(home):
    return gril.make(f"{home / 'my_task.py'}:make")


@pytest.fixture(scope="module")
def rewards(home, demos, task):
    small = str(home / "small.yaml")
    return gril.learn_reward(demos, preset=small, task=task, seeds=2, **QUIET)


@pytest.fixture(scope="module")
def policy(home, task, rewards):
    return gril.train_policy(task, rewards, preset=str(home / "small.yaml"), seeds=2, **QUIET)


def test_a_reward_for_each_seed_says_how_well_it_orders_videos(rewards, demos):
    assert [one.about["provenance"]["seed"] for one in rewards] == [0, 1]
    assert all(-1 <= one.about["provenance"]["kendall_tau"] <= 1 for one in rewards)
    center, size, label, _ = map(jnp.asarray, demos[0].tracks)
    trace = rewards[0].trajectory(center, size, label=label)
    assert trace.shape == (len(center),)
    assert np.isfinite(trace).all()


def test_a_reward_is_saved_and_loaded_bit_for_bit(rewards, tmp_path):
    rewards[0].save(tmp_path / "reward.npz")
    again = gril.load_reward(tmp_path / "reward.npz")
    jax.tree.map(np.testing.assert_array_equal, again.params, rewards[0].params)
    assert again.about == rewards[0].about


def test_a_reward_without_a_stage_says_which_options_find_more(rewards, demos):
    with pytest.raises(RunError, match=r"no end of a stage, .* lower prominence \(it was 9\)"):
        gril.find_subtasks(rewards[0], demos, prominence=9.0)


def test_a_policy_for_each_seed_has_its_curves_and_its_success(policy, task):
    assert len(policy) == 2
    steps, success = policy.curves["env_steps"], policy.curves["success"]
    assert steps.tolist() == [32, 64]
    assert success.shape == (2, 2)
    found = policy.evaluate(episodes=4)
    assert found.success.shape == (2,)
    assert "mean of 2 policies" in str(found)
    compiled = evaluate._cache_size(), begin._cache_size()
    alone = gril.evaluate(policy[1], episodes=4)
    policy.evaluate(episodes=4, seed=7)
    assert (evaluate._cache_size(), begin._cache_size()) == compiled  # other seeds of either kind
    np.testing.assert_array_equal(alone.success, found.success[1:])
    assert "4 starts" in str(alone)


def test_a_task_without_a_reward_trains_no_policy_on_its_own(home, task):
    with pytest.raises(ConfigError, match="the states of my_task have no `reward`: give them one"):
        gril.train_policy(task, preset=str(home / "small.yaml"), **QUIET)


def test_a_policy_is_saved_loaded_and_filmed(policy, home, tmp_path):
    policy.save(tmp_path / "policy.npz")
    policy.film(tmp_path / "film.mp4", episodes=2)
    assert (tmp_path / "film.mp4").stat().st_size > 100
    again = gril.load_policy(tmp_path / "policy.npz")
    assert again.config.env.name == f"{home / 'my_task.py'}:make"  # for other processes, too
    np.testing.assert_array_equal(
        again.evaluate(episodes=4).success, policy[policy.best].evaluate(episodes=4).success
    )
    assert callable(load_policy(tmp_path / "policy.npz"))  # with NumPy alone


def test_the_command_line_learns_the_same_reward_and_policy(home, rewards, task, tmp_path):
    """Bit for bit: a verb is these functions with a run's folder around them."""
    run, small = tmp_path / "run", str(home / "small.yaml")
    name = f"{home / 'my_task.py'}:make"
    args = ["--task", name, "--demos", str(home / "set"), "--out", str(run)]
    assert main.main(["train", small, *args]) == 0
    for what, file in (("policy", "theirs.npz"), ("reward", "reward.npz")):
        export = ["export", str(run), "--what", what, "--out", str(tmp_path / file)]
        assert main.main(export) == 0
    reward = gril.load_reward(tmp_path / "reward.npz")
    ours = gril.train_policy(name, reward, preset=small, **QUIET)
    ours.save(tmp_path / "ours.npz")
    arrays = [np.load(tmp_path / f"{who}.npz") for who in ("ours", "theirs")]
    for key in arrays[0].files:
        if key != "description":
            np.testing.assert_array_equal(arrays[0][key], arrays[1][key])
    again = gril.load_policy(run)  # the folder of the run itself
    jax.tree.map(np.testing.assert_array_equal, again.parameters, ours.parameters)
    np.testing.assert_array_equal(again.evaluate(4).success, ours.evaluate(4).success)
    learned = gril.learn_reward(gril.load_demos(home / "set"), preset=small, task=name, **QUIET)
    jax.tree.map(np.testing.assert_array_equal, learned.params, reward.params)
    # The task has no stages: its audit is of the videos alone, in Python as on the command line.
    assert main.main(["audit", str(run), "--ascents", "20"]) == 0
    found = json.loads((run / "audit" / "audit.json").read_text())
    options = {"preset": small, "ascents": 20}
    ours = gril.audit_reward(reward, name, demos=gril.load_demos(home / "set"), **options)
    assert (ours.kind, ours.passed, ours.verdict) == ("videos", found["passed"], found["verdict"])
    assert "no state was searched" in ours.verdict.lower()
    for figure in ("touch_share", "misranked_share", "best_amiss_share", "tau", "consistency",
                   "voc_pearson", "voc_spearman_tails", "reward_time_tau"):  # fmt: skip
        assert ours.figures[figure] == pytest.approx(found[figure], abs=1e-6)
    told = [line for line in ours.lines if line.startswith("done_level")]
    level = ours.figures.get("done_level")  # None if a displaced object leaves the reward higher
    assert level == pytest.approx(found["done_level"], abs=1e-6)
    assert (level is None) == (found["best_amiss"] >= found["worst_end"]) == (not told)
    with pytest.raises(ConfigError, match=r"my_task has no `stages`, .* demos=\.\.\."):
        gril.audit_reward(reward, name)


def test_nothing_is_printed_and_nothing_written(home, demos, task, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    gril.learn_reward(demos, preset=str(home / "small.yaml"), task=task, **QUIET)
    said = capfd.readouterr()
    assert said.out == ""
    assert said.err == ""
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        ({"pretrian": {"steps": 3}}, r"no option 'pretrian' \(did you mean pretrain\?\)"),
        ({"pretrain": {"step": 3}}, r"pretrain has no field 'step' \(did you mean steps\?\)"),
        ({"pretrain": 3}, "pretrain is 3, but must be a dictionary of its fields"),
        ({"pretrain": {"steps": 0}}, "pretrain.steps is 0, but must be"),
        ({"preset": "lunch"}, "there is no configuration 'lunch'"),
    ],
)
def test_a_wrong_option_is_one_sentence(demos, options, fault):
    with pytest.raises(ConfigError, match=fault):
        gril.learn_reward(demos, **options)


def test_what_does_not_fit_together_is_one_sentence(home, demos, task, rewards):
    small = str(home / "small.yaml")
    with pytest.raises(ConfigError, match="learned for the classes mat, hand, puck, but"):
        gril.train_policy("match_regions", rewards[0], **QUIET)
    with pytest.raises(ConfigError, match="2 rewards for 3 seeds: give one for each"):
        gril.train_policy(task, rewards, preset=small, seeds=3, **QUIET)
    with pytest.raises(ConfigError, match="need the demonstrations"):
        gril.train_policy(task, rewards[0], preset=small, run={"reward": "stages"}, **QUIET)
    with pytest.raises(ConfigError, match="an audit needs a task, or the demonstrations"):
        gril.audit_reward(rewards[0])
    with pytest.raises(DemoError, match="its class names are not those"):
        gril.learn_reward(demos, task="match_regions", **QUIET)


def test_an_object_of_a_users_class_is_a_task(home, task, rewards):
    """An environment that was made elsewhere, such as in a notebook, needs no name."""
    small = str(home / "small.yaml")
    mine = task.task
    by_name = gril.train_policy(task, rewards[0], preset=small, **QUIET)
    by_object = gril.train_policy(mine, rewards[0], preset=small, **QUIET)
    jax.tree.map(np.testing.assert_array_equal, by_name.parameters, by_object.parameters)


@pytest.mark.slow  # five minutes
def test_videos_become_a_policy_as_good_as_the_quickstarts(tmp_path):
    quickstart = {"preset": "quickstart", **QUIET}
    demos = gril.record_demos("match_regions", tmp_path / "demos", **quickstart)
    reward = gril.learn_reward(demos, **quickstart)
    policy = gril.train_policy("match_regions", reward, **quickstart)
    assert policy.evaluate(episodes=256).success[0] >= 0.9
    policy.film(tmp_path / "policy.mp4")
