"""One file for a reward: it comes back bit for bit, and nothing else is taken for one."""

import dataclasses
import errno
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.planted_faults import faults
from support.saved_rewards import CLASSES, CONFIGS, OBJECTS, made, moment, scene

from gril_jax.encoders import encoder
from gril_jax.errors import ConfigError, GrilError, ShapeError
from gril_jax.export.reward_file import RewardFileError, load_reward, save_reward
from gril_jax.export.reward_format import packed
from gril_jax.losses import heads
from gril_jax.reward.latent_goal import latent_goal_reward
from gril_jax.types import DemoBatch

PAPER = CONFIGS["paper"]
GIVEN = {"classes": CLASSES, "robots": ("robot",), "objects": OBJECTS}


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("rewards") / "reward.npz"
    save_reward(path, made(PAPER), PAPER, **GIVEN)
    return path


def _edited(path, out, arrays=None, drop=(), **about):
    """A copy with other arrays or fields of the description."""
    with np.load(path) as content:
        content = {name: content[name] for name in content.files if name not in drop}
    description = json.loads(str(content.pop("description"))) | about
    Path(out).write_bytes(packed(content | (arrays or {}), json.dumps(description)))
    return out


# --- what is saved comes back


@pytest.mark.parametrize("kind", CONFIGS)
def test_every_encoder_comes_back_bit_for_bit(tmp_path, kind):
    config, params = CONFIGS[kind], made(CONFIGS[kind])
    classes = ("anything",) if kind == "pixel" else CLASSES
    save_reward(tmp_path / "reward.npz", params, config, classes=classes)
    learned = load_reward(tmp_path / "reward.npz")
    assert learned.config == config
    assert jax.tree.structure(learned.params) == jax.tree.structure(params)
    assert jax.tree.all(jax.tree.map(np.array_equal, learned.params, params))
    value = jax.jit(latent_goal_reward)
    seen = moment(config)
    assert value(learned.params, seen, learned.config) == value(params, seen, config)


def test_choices_and_provenance_come_back(tmp_path):
    demos = DemoBatch(*scene(2, 5), jnp.array([5, 4]))
    save_reward(
        tmp_path / "r",
        made(PAPER),
        PAPER,
        **GIVEN,
        activity={"tau": 0.01, "window": 7, "smoothing": 3, "noise": 0.002},
        half_extent=1.1,
        unit="arena units",
        demos=demos,
        provenance={"kendall_tau": 0.95},
    )
    learned = load_reward(tmp_path / "r")
    assert (learned.classes, learned.robots, learned.objects) == tuple(GIVEN.values())
    assert learned.activity == (0.01, 7, 3, 0.002)
    about = learned.about
    assert (about["half_extent"], about["unit"]) == (1.1, "arena units")
    assert about["provenance"]["kendall_tau"] == 0.95
    assert about["provenance"]["num_demos"] == 2
    assert len(about["provenance"]["demos_sha256"]) == 64
    assert about["provenance"]["gril_jax"]


def test_the_digest_of_demonstrations_sees_every_array(tmp_path):
    demos, digests = DemoBatch(*scene(2, 5), jnp.array([5, 4])), set()
    for i, changed in enumerate(
        [demos, demos._replace(length=jnp.array([5, 5])), demos._replace(center=demos.center + 1)]
    ):
        save_reward(tmp_path / str(i), made(PAPER), PAPER, **GIVEN, demos=changed)
        digests.add(load_reward(tmp_path / str(i)).about["provenance"]["demos_sha256"])
    assert len(digests) == 3


def test_a_set_of_goals_is_kept(tmp_path):
    params = made(PAPER)._replace(goal=jnp.ones((3, PAPER.latent)))
    save_reward(tmp_path / "r", params, PAPER, **GIVEN)
    assert load_reward(tmp_path / "r").params.goal.shape == (3, PAPER.latent)


def test_a_file_is_loaded_saved_and_equal_to_the_byte(file, tmp_path):
    learned = load_reward(file)
    save_reward(tmp_path / "again", learned.params, learned.config, **GIVEN)
    assert (tmp_path / "again").read_bytes() == file.read_bytes()


# --- writing


def test_a_file_is_overwritten_only_if_told(file, tmp_path):
    path = tmp_path / "reward.npz"
    path.write_text("mine")
    with pytest.raises(RewardFileError, match="exists already"):
        save_reward(path, made(PAPER), PAPER, **GIVEN)
    with pytest.raises(RewardFileError, match=r"nowhere.*folder must exist"):
        save_reward(tmp_path / "nowhere" / "r", made(PAPER), PAPER, **GIVEN)
    assert path.read_text() == "mine"
    save_reward(path, made(PAPER), PAPER, **GIVEN, overwrite=True)
    assert path.read_bytes() == file.read_bytes()
    assert os.listdir(tmp_path) == ["reward.npz"]


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_full_disk_leaves_everything_as_it_was(tmp_path, monkeypatch, overwrite):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    path = tmp_path / "reward.npz"
    if overwrite:
        path.write_text("mine")
    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(RewardFileError, match="No space left"):
        save_reward(path, made(PAPER), PAPER, **GIVEN, overwrite=overwrite)
    assert os.listdir(tmp_path) == (["reward.npz"] if overwrite else [])


def _wrong_params():
    params = made(PAPER)
    yield params._replace(goal=jnp.zeros(3)), ShapeError, r"goal has shape \(3,\).*\(5,\)"
    yield params._replace(goal=jnp.zeros((0, 5))), ShapeError, "goal"
    yield params._replace(scale=jnp.full((), jnp.nan)), RewardFileError, "scale is not finite"
    half = params._replace(alpha=jnp.ones((), jnp.bfloat16))
    yield half, RewardFileError, "alpha is bfloat16; it must be float32"
    many = jax.tree.map(lambda x: jnp.stack([x, x]), params)
    yield many, ShapeError, "it must be"
    less = params._replace(encoder={"head": params.encoder["head"]})
    yield less, RewardFileError, "params lacks the array 'encoder.messages"
    more = params._replace(encoder=params.encoder | {"tail": jnp.ones(1)})
    yield more, RewardFileError, "array 'encoder.tail'"


@pytest.mark.parametrize(("params", "error", "text"), _wrong_params())
def test_parameters_that_are_not_the_encoders_are_not_written(tmp_path, params, error, text):
    with pytest.raises(error, match=text):
        save_reward(tmp_path / "r", params, PAPER, **GIVEN)
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"classes": CLASSES[:3]}, "classes holds 3 names but encoder.num_classes is 4"),
        ({"classes": ("a", "b", "c", "a")}, "names must differ"),
        ({"robots": ("arm",)}, "robots names 'arm'; it must be one of"),
        ({"objects": ("ball",)}, "objects names 'ball'"),
        ({"half_extent": 0.0}, "half_extent is 0.0"),
        ({"activity": {"tau": -1.0}}, "tau is -1.0"),
        ({"activity": {"memory": 2}}, "activity.memory is unknown"),
        ({"activity": {"window": 1.5}}, "activity.window is 1.5; it must be int"),
        ({"provenance": {"tau": float("nan")}}, "must be JSON"),
    ],
)
def test_choices_out_of_range_are_not_written(tmp_path, given, text):
    chosen = {"classes": CLASSES} | given
    with pytest.raises(ConfigError, match=text):
        save_reward(tmp_path / "r", made(PAPER), PAPER, **chosen)
    assert os.listdir(tmp_path) == []


# --- reading what is no reward file


def test_a_file_without_an_option_that_came_later_is_read(file, tmp_path):
    about = encoder.to_json(PAPER)
    del about["pair_statistics"]
    assert load_reward(_edited(file, tmp_path / "earlier.npz", encoder=about)).config == PAPER


@pytest.mark.parametrize(
    ("about", "error", "text"),
    [
        ({"version": 4}, RewardFileError, "has version 4, but .* gril-jax reads 3"),
        ({"version": True}, RewardFileError, "has version True"),
        ({"format": "gril-jax policy"}, RewardFileError, "has format 'gril-jax policy'"),
        ({"encoder": {"kind": "transformer"}}, ConfigError, "encoder.kind is 'transformer'"),
        ({"encoder": {"kind": "paper"}}, ConfigError, "encoder.num_classes is missing"),
        ({"encoder": {"kind": "mlp", "rounds": 2}}, ConfigError, "encoder.rounds is unknown"),
        ({"encoder": {"kind": "mlp", "num_classes": 4, "width": 1.5}}, ConfigError, "1.5"),
        ({"encoder": {"kind": "mlp", "num_classes": -4}}, ConfigError, "at least 1"),
        ({"encoder": dataclasses.asdict(PAPER) | {"kind": "paper", "width": 9}}, ShapeError, "9"),
        (
            {"classes": "four"},
            ConfigError,
            "classes is 'four'; it must be a list of printable names",
        ),
        ({"activity": {"window": 10.5}}, ConfigError, "activity.window is 10.5; it must be int"),
        ({"activity": {"tau": 10**40}}, ConfigError, "activity.tau is 1.*at most"),
        ({"encoder": {"kind": "paper", "rounds": 10**9}}, ConfigError, "rounds.*at most 100"),
        ({"encoder": {"kind": []}}, ConfigError, "encoder.kind is "),
        ({"activity": None}, ConfigError, "activity is None"),
        ({"half_extent": 0}, ConfigError, "half_extent is 0; it must be a number above 0"),
    ],
)
def test_a_description_that_is_not_understood_is_refused(file, tmp_path, about, error, text):
    path = _edited(file, tmp_path / "other.npz", **about)
    with pytest.raises(error, match=text) as raised:
        load_reward(path)
    assert str(path) in str(raised.value)


@pytest.mark.parametrize(
    ("drop", "arrays", "error", "text"),
    [
        (("goal",), {}, RewardFileError, "lacks the array 'goal'"),
        (("encoder.head.Dense_0.bias",), {}, RewardFileError, "lacks the array 'encoder.head"),
        ((), {"extra": np.zeros(3, np.float32)}, RewardFileError, "an array 'extra'"),
        ((), {"goal": np.zeros(9, np.float32)}, ShapeError, r"goal has shape \(9,\).*\(5,\)"),
        ((), {"goal": np.zeros(5)}, RewardFileError, "holds <f8"),
        ((), {"goal": np.full(5, np.inf, np.float32)}, RewardFileError, "goal is not finite"),
        ((), {"goal": np.array([{}] * 5)}, RewardFileError, "damaged"),  # a pickle
    ],
)
def test_arrays_that_are_not_the_encoders_are_refused(file, tmp_path, drop, arrays, error, text):
    _edited(file, tmp_path / "other.npz", arrays, drop)
    with pytest.raises(error, match=text) as raised:
        load_reward(tmp_path / "other.npz")
    assert "other.npz" in str(raised.value)


@pytest.mark.parametrize(
    "content", [b"", b"PK", b"PK\x03\x04", b"\x80\x04cos\nsystem\n", b"x" * 99]
)
def test_a_file_of_another_kind_is_refused(tmp_path, content):
    path = tmp_path / "other.npz"
    path.write_bytes(content)
    with pytest.raises(RewardFileError, match=r"other\.npz"):
        load_reward(path)


def test_a_missing_file_and_a_folder_are_told_apart(tmp_path):
    with pytest.raises(RewardFileError, match="does not exist"):
        load_reward(tmp_path / "none.npz")
    with pytest.raises(RewardFileError, match="is a folder"):
        load_reward(tmp_path)


def test_a_file_that_is_cut_short_is_refused(file, tmp_path):
    whole = file.read_bytes()
    path = tmp_path / "short.npz"
    for size in np.linspace(0, len(whole) - 1, 60).astype(int):
        path.write_bytes(whole[:size])
        with pytest.raises(RewardFileError, match=r"short\.npz"):
            load_reward(path)


def test_planted_faults_are_refused_in_one_sentence(file, tmp_path):
    path, trap = tmp_path / "planted.npz", tmp_path / "unpickled"
    tried = 0
    for name, damaged in faults(file.read_bytes(), trap):
        path.write_bytes(damaged)
        with pytest.raises(GrilError) as raised:
            load_reward(path)
        assert re.fullmatch(f".{{,90}}{path}.{{9,200}}", str(raised.value)), name
        tried += 1
    assert tried > 90
    assert not trap.exists()


def test_loading_a_reward_loads_no_simulator_and_no_command_line():
    code = (
        "import sys, gril_jax.export.reward_file\n"
        "heavy = {'mujoco', 'brax', 'cv2', 'orbax', 'tyro', 'optax', 'matplotlib', 'av'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.split("\n")[0] == "[]", done.stdout + done.stderr


def test_kinds_of_encoders_are_all_known():
    assert {*encoder.KINDS.values()} == {*encoder._KINDS}
    for config in CONFIGS.values():
        text = json.dumps(encoder.to_json(config))
        assert encoder.from_json(json.loads(text)) == config


# --- a method that predicts progress


def _with_head(method):
    config = PAPER
    head = heads.of(method).init(jax.random.key(0), config.latent)
    return made(config)._replace(head=head, start=jnp.arange(config.latent, dtype=jnp.float32))


@pytest.mark.parametrize("method", ["timerewarder", "rewind", "sarm", "progressor"])
def test_a_head_comes_back_bit_for_bit_and_is_the_reward(tmp_path, method):
    params, out = _with_head(method), tmp_path / "reward.npz"
    save_reward(out, params, PAPER, **GIVEN)
    learned = load_reward(out)
    assert learned.about["head"] == method
    assert jax.tree.structure(learned.params) == jax.tree.structure(params)
    assert jax.tree.all(jax.tree.map(np.array_equal, learned.params, params))
    seen = moment(PAPER)
    assert latent_goal_reward(learned.params, seen, PAPER) == latent_goal_reward(
        params, seen, PAPER
    )


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"head": "tcc"}, ConfigError, "head is 'tcc'; it must be 'timerewarder'"),
        ({"head": ["sarm"]}, ConfigError, "head is .'sarm'.; it must be"),
        ({"head": "rewind"}, GrilError, "head.kernel has shape"),
        ({"head": None}, RewardFileError, "has an array 'head.kernel'"),
        ({"drop": ("start",)}, RewardFileError, "lacks the array 'start'"),
        ({"arrays": {"goal": np.ones((2, 5), np.float32)}}, ShapeError, "goal has shape"),
    ],
)
def test_a_head_that_does_not_fit_its_file_is_refused(tmp_path, change, error, words):
    save_reward(tmp_path / "reward.npz", _with_head("timerewarder"), PAPER, **GIVEN)
    with pytest.raises(error, match=words):
        load_reward(_edited(tmp_path / "reward.npz", tmp_path / "other.npz", **change))


def test_an_ensemble_with_a_head_is_refused(tmp_path):
    params = made(CONFIGS["ensemble"])._replace(head=_with_head("rewind").head, start=jnp.ones(6))
    with pytest.raises(ConfigError, match="ensemble_size is 2; with a head it must be 1"):
        save_reward(tmp_path / "reward.npz", params, CONFIGS["ensemble"], **GIVEN)
