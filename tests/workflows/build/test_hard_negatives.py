"""Scenes of earlier policies: how a run gets them, keeps them, and what it refuses."""

import contextlib
import dataclasses
import shutil
import sys
import types
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.probes import Probe, carried

from gril_jax.audit.scene_reward import Scene
from gril_jax.cli import arguments
from gril_jax.cli import main as cli
from gril_jax.config import EncoderOptions, EnvConfig, PPOConfig, RunConfig, RunSettings
from gril_jax.errors import ConfigError, RunError
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.rl.policy import Policy
from gril_jax.runs import reading, run_dir
from gril_jax.runs.progress import Progress
from gril_jax.workflows.build import hard_negatives, policy_setup, setup

CONFIG = RunConfig(
    encoder=EncoderOptions(width=4, rounds=0, latent=2),
    ppo=PPOConfig(num_envs=4, hidden=(4,)),
    run=RunSettings(eval_episodes=3),
)


def test_a_reward_of_pictures_learns_from_no_policy(tmp_path):
    pictures = dataclasses.replace(CONFIG, encoder=EncoderOptions(kind="pixels"))
    hard_negatives.require_boxes(pictures, [])
    for new, old in ((pictures, CONFIG), (CONFIG, pictures)):
        earlier = _trained_as(old)
        with pytest.raises(ConfigError, match=r"must be 'paper', .* for --hard-negatives"):
            hard_negatives.require_boxes(new, [earlier])
    hard_negatives.require_boxes(CONFIG, [_trained_as(CONFIG)])
    loss = dataclasses.replace(CONFIG.loss, consistency="rewind")
    with pytest.raises(ConfigError, match=r"consistency is 'rewind', whose reward is no dist"):
        hard_negatives.require_boxes(dataclasses.replace(CONFIG, loss=loss), [_trained_as(CONFIG)])


def _trained_as(config):
    return hard_negatives.EarlierPolicy(Path("gone"), config, None, None, None, None)


@pytest.fixture(scope="module")
def earlier():
    """A fresh policy, and a reward that tells nothing apart and so is always 0."""
    probe = Probe(episode_length=12)
    ppo = policy_setup.make_algorithm(CONFIG, probe, "ppo")
    state = jax.jit(ppo.init)(jax.random.key(0), policy_setup.algorithm_hyper(CONFIG, "ppo"))
    blind = jax.tree.map(jnp.zeros_like, setup.blank_reward(CONFIG, len(probe.classes)))
    blind = RewardParams(blind.encoder, blind.goal, jnp.float32(1.0), jnp.float32(5.0))
    policy = Policy(state.normalizer, state.params.policy)
    return hard_negatives.EarlierPolicy(Path("gone"), CONFIG, ppo, policy, blind, blind)


@pytest.fixture
def begin(tmp_path):
    """Creates a run that learns from some policies."""
    with contextlib.ExitStack() as opened:

        def create(policies):
            known = {"experiment": "pretrain", "begun": hard_negatives.noted(policies)}
            run = run_dir.create(tmp_path / "new", CONFIG, device="cpu", **known)
            return opened.enter_context(run)

        yield create


def _gather(policies, run, said=None):
    echo = (lambda line: None) if said is None else said.append
    return hard_negatives.gather_once(policies, CONFIG, carried(), run, Progress(), echo=echo)


@pytest.mark.slow
def test_the_scenes_are_played_once_and_then_read_from_the_folder(earlier, begin):
    said = []
    run = begin([earlier])
    pool = _gather([earlier], run, said)
    num = len(pool.label)
    assert 1 < num <= 6 * 13
    assert said == [f"{num} scenes of gone are overestimated and will be learned from"]
    np.testing.assert_array_equal(pool.label, np.tile(np.arange(3), (num, 1)))
    np.testing.assert_array_equal(pool.is_robot, pool.label == 1)
    np.testing.assert_array_equal(pool.center[:, 0], np.full((num, 2), 0.5))
    assert (np.asarray(pool.center[:, 2, 1]) == 0).all()  # where the probe's block moves
    assert np.asarray(pool.active[:, 2]).any()
    again = _gather([], run, said)  # the earlier run is not there, and not asked for
    jax.tree.map(np.testing.assert_array_equal, pool, again)
    assert len(said) == 1
    assert run.finished_phase("hard_negatives")["scenes"] == [num]


@pytest.mark.slow
def test_a_reward_that_pays_less_than_is_due_gives_no_scenes(earlier, begin):
    strict = earlier.learned._replace(goal=jnp.full(2, 10.0))
    run = begin([earlier])
    assert _gather([earlier._replace(learned=strict)], run) is None
    assert run.finished_phase("hard_negatives")["scenes"] == [0]
    assert _gather([], run) is None


def test_a_run_that_noted_none_gathers_none(begin):
    run = begin([])
    assert _gather([], run) is None
    assert not (run.path / "hard_negatives.npz").exists()


def test_a_run_notes_them_as_it_is_created(earlier, begin):
    run = begin([earlier])
    noted = reading.read_phases(run.path).finished["hard_negatives_of"]
    assert noted == {"runs": [str(Path("gone").resolve())]}


def test_scenes_that_were_changed_or_lost_are_refused(earlier, begin, monkeypatch):
    monkeypatch.setattr(hard_negatives, "_overestimated", lambda *_: _two_scenes())
    run = begin([earlier, earlier])
    assert len(_gather([earlier, earlier], run).label) == 4
    file = run.path / "hard_negatives.npz"
    whole = file.read_bytes()
    file.write_bytes(whole[:-1] + b"x")
    with pytest.raises(RunError, match="has been changed or lost, so the run cannot go on"):
        _gather([], run)
    file.unlink()
    with pytest.raises(RunError, match="has been changed or lost"):
        _gather([], run)


def _two_scenes():
    no = np.zeros((2, 3), bool)
    return Scene(np.zeros((2, 3, 2)), np.ones((2, 3, 2)), np.zeros((2, 3), int), no, no)


def test_a_run_that_was_cut_off_before_it_had_them_needs_the_noted_run(earlier, begin):
    run = begin([earlier])
    with pytest.raises(ConfigError, match=r"--hard-negatives: .*gone does not exist"):
        _gather([], run)


def test_a_policy_that_cannot_be_read_is_one_sentence_before_work(tmp_path, capsys):
    path = _folder(tmp_path / "damaged")
    (path / "policy" / "000000000640" / "manifest.json").write_text("{}")
    out = tmp_path / "out"
    assert cli.main(["pretrain", "--out", str(out), "--hard-negatives", str(path)]) == 2
    err = capsys.readouterr().err
    assert err.startswith("gril: --hard-negatives: ")
    assert err.count("\n") == 1
    assert not out.exists()


# --- the command line, with a stand-in for the work


def _folder(path, config=None):
    """A run with what a policy's checkpoint is known by."""
    run_dir.create(path, config or RunConfig(), device="cpu", experiment="pretrain").close()
    (path / "policy" / "000000000640").mkdir(parents=True)
    (path / "policy" / "000000000640" / "manifest.json").write_text("{}")
    return path


@pytest.fixture
def main(monkeypatch):
    """The calls to the experiment of either verb."""
    calls = []
    for name in ("pretrain", "train"):
        module = types.ModuleType(f"gril_jax.workflows.{name}")
        module.main = lambda *args, **kwargs: calls.append(kwargs)
        monkeypatch.setitem(sys.modules, module.__name__, module)
        monkeypatch.setattr(module.__name__, module, raising=False)
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "unused")
    return calls


@pytest.mark.parametrize("verb", ["pretrain", "train"])
def test_one_or_two_runs_are_handed_on(main, tmp_path, verb):
    one, two = _folder(tmp_path / "one"), _folder(tmp_path / "two")
    assert cli.main([verb, "--hard-negatives", str(one)]) == 0
    assert cli.main([verb, f"--hard-negatives={one},{two}", "--seed", "3"]) == 0
    assert cli.main([verb]) == 0
    assert main == [
        {"echo": arguments.echo, "hard_negatives": [one]},
        {"echo": arguments.echo, "hard_negatives": [one, two]},
        {"echo": arguments.echo},
    ]


def test_wrong_runs_are_refused_in_one_sentence(main, tmp_path, capsys):
    def fault(names, *args):
        assert cli.main(["pretrain", "--hard-negatives", names, *args]) == 2
        err = capsys.readouterr().err
        assert err.count("\n") == 1
        return err

    run = _folder(tmp_path / "run")
    three = ",".join([str(run)] * 3)
    assert "names 3 runs, but must be one run, or two with a comma between" in fault(three)
    assert "names 0 runs, but must be" in fault("")
    assert "does not exist, but must be the folder of a run" in fault(str(tmp_path / "no"))
    other = _folder(tmp_path / "other", RunConfig(env=EnvConfig(targets=("green square",))))
    err = fault(f"{run},{other}")
    assert "other has env.targets ('green square',), but must have that of the new run" in err
    err = fault(str(run), "--resume", str(run))
    assert "is given beside --resume, but a run that goes on has its own" in err
    shutil.rmtree(run / "policy")
    assert "has no policy, so its run has not got that far yet" in fault(str(run))
    assert main == []


# --- the whole of it

SMALL = (
    *("--demos.num", "6", "--demos.num-validation", "2", "--demos.num-failures", "2"),
    *("--pretrain.steps", "20", "--pretrain.num-videos", "4"),
    *("--encoder.width", "16", "--encoder.latent", "8", "--env.episode-length", "90"),
    *("--ppo.num-envs", "16", "--ppo.unroll-length", "5", "--ppo.num-timesteps", "160"),
    *("--ppo.hidden", "16", "--run.eval-episodes", "4", "--run.evaluations", "0"),
    *(
        "--pretrain.num-perturbations",
        "0",
        "--pretrain.adversarial-steps",
        "0",
        "--encoder.rounds",
        "1",
        "--run.audit",
        "0",
    ),
)


@pytest.mark.slow
def test_a_run_that_is_cut_off_around_its_scenes_ends_as_an_undisturbed_one(tmp_path, monkeypatch):
    first, whole, cut = (str(tmp_path / name) for name in ("first", "whole", "cut"))
    assert cli.main(["train", "quickstart", "--out", first, *SMALL]) == 0
    again = ("--demos", f"{first}/demos", *SMALL, "--hard-negatives", first)
    assert cli.main(["pretrain", "quickstart", "--out", whole, *again]) == 0

    def cut_off(*_):
        raise RunError("cut off")

    with monkeypatch.context() as patch:
        patch.setattr(hard_negatives, "_overestimated", cut_off)  # before the scenes are there
        assert cli.main(["pretrain", "quickstart", "--out", cut, *again]) == 1
    with monkeypatch.context() as patch:
        patch.setattr(hard_negatives, "_read", cut_off)  # and after, when they need no run any more
        assert cli.main(["pretrain", "--resume", cut]) == 1
    shutil.rmtree(tmp_path / "first" / "policy")
    assert cli.main(["pretrain", "--resume", cut]) == 0
    results = [run_dir.read_results(Path(path)) for path in (whole, cut)]
    assert results[0]["hard_negatives"] > 0
    for name in ("state_sha256", "reward_sha256", "hard_negatives"):
        assert results[0][name] == results[1][name]
