"""`gril audit`: what it refuses, in one sentence each, and a whole audit."""

import dataclasses
import json
import types
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.audit_findings_made import findings
from support.kinematic_demos import kinematic_demos
from support.run_folders import save_run

from gril_jax.audit.scene_reward import Scene
from gril_jax.cli import main
from gril_jax.config import EncoderOptions, EnvConfig, RunConfig, RunSettings
from gril_jax.demos.demo_set import DemoSet
from gril_jax.encoders import encoder
from gril_jax.errors import ConfigError, RunError
from gril_jax.export.reward_file import load_reward, save_reward
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.reward.learned_reward import LearnedReward
from gril_jax.workflows import audit
from gril_jax.workflows.build import setup
from gril_jax.workflows.build.demonstrations import Demonstrations
from gril_jax.workflows.study.recipe import changed

CLASSES = setup.make_env(EnvConfig(), training=False).classes
OBJECTS = ("goal", "robot", "green square")
CONFIG = encoder.EncoderConfig(len(CLASSES), width=4, rounds=1, latent=3)


def _params(config=CONFIG):
    rng = np.random.default_rng(0)
    shapes = jax.eval_shape(lambda key: encoder.init(key, config), jax.random.key(0))
    drawn = lambda x: rng.uniform(0, 0.01, x.shape)  # variances are not negative  # noqa: E731
    params = jax.tree.map(lambda x: jnp.asarray(drawn(x), jnp.float32), shapes)
    goal = jnp.ones(config.latent)
    return RewardParams(params, goal, jnp.float32(0.5), jnp.float32(5.0))


def _save(path, config=CONFIG, **changes):
    choices = {"classes": CLASSES, "robots": ("robot",), "objects": OBJECTS} | changes
    save_reward(path, _params(config), config, **choices)
    return path


def _fault(capsys, *args, code=2):
    assert main.main(["audit", *map(str, args)]) == code
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    return err


# --- refused before any work


def test_a_mistake_on_the_command_line_has_exit_code_2(tmp_path, capsys):
    assert "must be a reward file or the folder of a run" in _fault(capsys, tmp_path / "none.npz")
    assert "has no config.yaml" in _fault(capsys, tmp_path)
    run = save_run(tmp_path / "run")
    assert "has no reward, so its run has not got that far yet" in _fault(capsys, run)
    file = tmp_path / "reward.npz"
    file.write_bytes(b"")
    assert "--starts is 0, but must be at least 1" in _fault(capsys, file, "--starts", "0")
    assert "--ascents is 0, but must be" in _fault(capsys, file, "--ascents", "0")
    assert "--seed is -1, but must be from 0" in _fault(capsys, file, "--seed=-1")
    assert "is a file, but --out must be a folder" in _fault(capsys, file, "--out", file)


def test_help_lists_the_options(capsys):
    assert main.main(["audit", "--help"]) == 0
    assert "--ascents" in capsys.readouterr().out


def test_a_run_that_asks_for_an_audit_that_is_not_possible_is_refused():
    asks = RunSettings(audit=5)
    pictures = RunConfig(encoder=EncoderOptions(kind="pixels"), run=asks)
    with pytest.raises(ConfigError, match=r"audit is 5, but must be 0, because an audit moves"):
        audit.require_possible(pictures)
    audit.require_possible(RunConfig(run=asks))


# --- refused once the reward is read


def test_a_reward_of_pictures_is_refused(tmp_path):
    pictures = RunConfig(encoder=EncoderOptions(kind="pixels"))
    with pytest.raises(ConfigError, match=r"'pixels', but must be 'paper', .* for an audit"):
        audit.main(save_run(tmp_path / "run", config=pictures))
    with pytest.raises(ConfigError, match="takes pictures, but an audit moves boxes"):
        audit.main(_save(tmp_path / "reward.npz", encoder.PixelConfig(3)))


def test_another_task_is_refused(tmp_path):
    reward = _save(tmp_path / "reward.npz")
    with pytest.raises(
        ConfigError, match="there is no task 'sorting': the tasks are match_regions"
    ):
        audit.main(reward, task="sorting")
    run = save_run(tmp_path / "run")
    with pytest.raises(ConfigError, match="was trained for match_regions, but --task is sorting"):
        audit.main(run, task="sorting")


def test_a_reward_of_other_objects_is_refused(tmp_path):
    mug = _save(tmp_path / "mug.npz", objects=("goal", "robot", "red star"))
    with pytest.raises(ConfigError, match="objects goal, robot, red star, but match_regions has"):
        audit.main(mug)
    names = tuple(name.replace("green", "grey") for name in CLASSES)
    grey = _save(tmp_path / "grey.npz", classes=names, objects=())
    with pytest.raises(ConfigError, match="knows no class 'green star', which the task has"):
        audit.main(grey)


def test_without_stages_and_videos_there_is_nothing_to_audit(tmp_path, monkeypatch):
    bare = types.SimpleNamespace(classes=CLASSES)
    monkeypatch.setattr(setup, "make_env", lambda *args, **kwargs: bare)
    with pytest.raises(ConfigError, match=r"match_regions has no `stages`, so .* with --demos"):
        audit.main(_save(tmp_path / "reward.npz"))


def test_classes_in_another_order_are_matched_by_name():
    turned = tuple(reversed(CLASSES))
    learned = LearnedReward(_params(), CONFIG, turned)
    label = audit._labels(learned, CLASSES, np.array([[0, 1, 3]]), "reward.npz")
    assert [turned[i] for i in label[0]] == [CLASSES[i] for i in (0, 1, 3)]


# --- what perturbed frames teach


def _shown(batch, perturbations=1):
    """A configuration and demonstrations, as an audit has them."""

    class Made(Demonstrations):
        def batch(self, split):
            return batch

    config = changed(RunConfig(), {"pretrain.num_perturbations": perturbations})
    return config, Made(DemoSet((), "", CLASSES, 1.0, 8.0, "made"), {}, 0)


def _last(batch):
    """The scene that the first video ends with."""
    still = batch.label[0], batch.is_robot[0], jnp.ones(4, bool)
    return Scene(batch.center[0, -1], batch.size[0, -1], *still)


def test_what_is_taught_is_0_at_the_ends_of_videos_and_minus_the_cost_elsewhere():
    batch = jax.tree.map(jnp.asarray, kinematic_demos(0, 6, num_objects=4))
    pay = audit._taught(LearnedReward(_params(), CONFIG, CLASSES), _shown(batch), Path("run"))
    last = _last(batch)
    aside = [last._replace(center=last.center.at[i].add(3.0)) for i in range(4)]
    assert float(pay(None, last)) == pytest.approx(0, abs=0.1)
    assert min(float(pay(None, scene)) for scene in aside) < -0.4


def test_only_a_run_with_perturbed_frames_says_what_it_was_taught(tmp_path):
    with pytest.raises(ConfigError, match=r"reward.npz does not say .* needs the folder of a run"):
        audit.main(_save(tmp_path / "reward.npz"), taught=True)
    learned = LearnedReward(_params(), CONFIG, CLASSES)
    with pytest.raises(RunError, match="run has lost its demonstrations: name them with --demos"):
        audit._taught(learned, None, Path("run"))
    with pytest.raises(ConfigError, match="num_perturbations of run is 0, but must be above 0"):
        audit._taught(learned, _shown(None, 0), Path("run"))


def test_with_taught_a_run_is_audited_by_what_its_videos_teach(tmp_path, monkeypatch):
    batch = jax.tree.map(jnp.asarray, kinematic_demos(0, 6, num_objects=4))
    config, shown = _shown(batch)
    learned, asked = LearnedReward(_params(), CONFIG, CLASSES), []
    (tmp_path / "demos").mkdir()
    (tmp_path / "demos" / "demos.json").touch()
    monkeypatch.setattr(audit.run_dir, "read_config", lambda *a, **k: config)
    monkeypatch.setattr(audit.export_reward, "of_run", lambda folder: learned)
    monkeypatch.setattr(audit.demonstrations, "chosen", lambda *a: shown)
    monkeypatch.setattr(audit, "_searched", lambda *a: (asked.append(a[-1]), (findings(), {}))[1])
    usual = tmp_path, None, None, None, 1
    for taught in (False, True):
        *_, about = audit._of_run(*usual, ascents=1, seed=0, taught=taught)
        assert about["taught"] == taught
    assert asked[0] is None

    def pay(params, scene):
        raise KeyError("asked in place of the reward")

    with pytest.raises(KeyError, match="asked in place"):
        audit.search(learned.for_objects(OBJECTS), audit.env_of(learned, None), "mine", pay=pay)
    assert float(asked[1](None, _last(batch))) == pytest.approx(0, abs=0.1)


# --- a whole audit


@pytest.fixture
def small(monkeypatch):
    """Short grids: the programs are the same."""
    monkeypatch.setattr(audit, "make_states", lambda *a, **k: _make(*a, **k, side=3))


_make = audit.make_states


def test_a_reward_file_is_audited_into_a_folder_beside_it(tmp_path, capsys, small):
    reward = _save(tmp_path / "mine.npz")
    args = ["audit", str(reward), "--starts", "1", "--ascents", "10"]
    assert main.main(args) == 0
    out = capsys.readouterr().out
    assert "report: " in out
    assert out.count("\n") == 8
    assert out.startswith("Fails its audit: ")
    folder = tmp_path / "mine-audit"
    assert {"audit.json", "report.html", "worst.png", "maps.png"} <= {
        p.name for p in folder.iterdir()
    }
    results = json.loads((folder / "audit.json").read_text())
    assert results["settings"]["ascents"] == 10
    assert results["alone_share"].keys() == {"green square", "robot"}
    best = {o["name"]: o["center"] for o in results["best_unearned_state"]["objects"]}
    offset = np.abs(np.array(best["green square"]) - best["goal"])
    assert (offset > [0.3, 0.35]).any()  # not in the region
    assert results["misranked"].keys() == results["worst_states"].keys()
    assert results["misranked_share"] == results["misranked"][results["worst_kind"]]


@pytest.mark.slow
def test_a_reward_that_is_no_number_somewhere_is_named(tmp_path, monkeypatch, small):
    learned = load_reward(_save(tmp_path / "reward.npz"))
    params = learned.params._replace(goal=jnp.full(3, jnp.nan))
    broken = dataclasses.replace(learned, params=params)
    monkeypatch.setattr(audit, "load_reward", lambda path: broken)
    with pytest.raises(RunError, match=r"the reward is nan instead of a number at goal \(0.400"):
        audit.main(tmp_path / "reward.npz", starts=1, ascents=10)
