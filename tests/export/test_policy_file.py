"""An exported policy acts like the run's own, with NumPy alone, and says what its arrays mean."""

import dataclasses
import functools
import json
import os
import pathlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.probes import Probe

from gril_jax.cli import main
from gril_jax.config import EnvConfig, PPOConfig, RunConfig, RunSettings
from gril_jax.config.encoder import PoolConfig
from gril_jax.errors import ConfigError, RunError, ShapeError
from gril_jax.export import policy_file
from gril_jax.export.read_policy import load_policy
from gril_jax.rl import rewards
from gril_jax.rl.policy import Policy
from gril_jax.rl.ppo import PPO, Hyper, Static
from gril_jax.runs import run_dir
from gril_jax.runs.checkpoints import checkpoint
from gril_jax.runs.reading import package_versions
from gril_jax.workflows.build import policy_setup, setup

OBSERVATIONS = 256
SMALL = RunConfig(
    env=EnvConfig(targets=("green square",), distractors=("yellow circle",), episode_length=10),
    ppo=PPOConfig(num_envs=2, num_minibatches=1, unroll_length=2, hidden=(16, 8)),
    run=RunSettings(reward="environmental"),
)


@functools.cache
def _probe(*, bits=True, hidden=(8, 6)):
    static = Static(num_envs=2, num_minibatches=1, hidden=hidden, observe_activity=bits, window=4)
    return PPO(Probe(), rewards.environmental, static)


@functools.cache
def _fresh(algorithm):
    return jax.jit(algorithm.init)(jax.random.key(2), Hyper())


def _seasoned(state, seed=0):
    """The state with statistics as after training: every third input has hardly ever varied."""
    rng = np.random.default_rng(seed)
    size = state.normalizer.mean.shape[0]
    std = np.where(np.arange(size) % 3 == 0, 1e-6, rng.uniform(0.02, 2, size))
    normalizer = state.normalizer.replace(
        mean=jnp.asarray(rng.uniform(-1, 1, size), jnp.float32), std=jnp.asarray(std, jnp.float32)
    )
    biased = jax.tree.map(  # fresh biases are 0, which would hide a wrong one
        lambda x: jnp.asarray(x + rng.normal(0, 0.1, x.shape), jnp.float32),
        jax.device_get(state.params.policy),
    )
    return state._replace(normalizer=normalizer, params=state.params.replace(policy=biased))


def _save_run(path, algorithm, config, *, state=None):
    run_dir.create(path, config, device="cpu").close()
    if state is None:
        state = _seasoned(_fresh(algorithm))
    checkpoint.save(path / "policy", 640, algorithm.policy(state))
    return state


def _lanes(algorithm, policy, seed=1):
    """Lanes with random observations: ordinary, beyond the clip, and near a constant's mean."""
    rng = np.random.default_rng(seed)
    begin = jax.jit(jax.vmap(algorithm.episodes.begin))
    lanes = begin(jax.random.split(jax.random.key(seed), OBSERVATIONS))
    own = lanes.state.obs.shape[1]
    mean, std = np.asarray(policy.normalizer.mean)[:own], np.asarray(policy.normalizer.std)[:own]
    spread = rng.choice([0.5, 3.0, 30.0], (OBSERVATIONS, 1))
    obs = mean + std * spread * rng.normal(size=(OBSERVATIONS, own))
    active = jnp.asarray(rng.integers(0, 2, lanes.memory.active.shape), bool)
    return lanes._replace(
        state=lanes.state._replace(obs=jnp.asarray(obs, jnp.float32)),
        memory=lanes.memory._replace(active=active),
    )


def _compare(algorithm, policy, act):
    """The largest difference of the two actions, over all lanes."""
    lanes = _lanes(algorithm, policy)
    key = jax.random.key(0)

    @jax.jit
    @jax.vmap
    def own(lane):
        action = algorithm.act(policy, lane, key, deterministic=True)
        return action, algorithm.episodes.observe(lane)

    wanted, seen = map(np.asarray, own(lanes))
    assert np.std(wanted, axis=0).min() > 1e-3  # the policy does not answer all alike
    many = act(seen)
    np.testing.assert_allclose(many[3], act(seen[3]), atol=1e-6)
    return np.abs(many - wanted).max()


# --- the whole of it, on the task


@pytest.fixture(scope="module")
def task():
    return policy_setup.make_algorithm(SMALL, setup.make_env(SMALL.env, training=False), "ppo")


@pytest.fixture(scope="module")
def exported(task, tmp_path_factory):
    """A run's folder, the state in its checkpoint, and the file that the command line made."""
    folder = tmp_path_factory.mktemp("export")
    state = _save_run(folder / "run", task, SMALL)
    out = folder / "policy.npz"
    assert main.main(["export", "--what", "policy", str(folder / "run"), "--out", str(out)]) == 0
    return folder, state, out


def test_the_reader_acts_like_the_policy_on_random_observations(task, exported):
    _, state, out = exported
    policy = Policy(state.normalizer, state.params.policy)
    assert _compare(task, policy, load_policy(out)) < 1e-5


def test_the_description_says_what_a_robot_must_feed_and_gets(task, exported):
    _, _, out = exported
    with np.load(out, allow_pickle=False) as file:
        about = json.loads(str(file["description"]))
    objects = ["goal", "robot", "green square", "yellow circle"]
    own = task.env.observation_size
    assert (about["format"], about["version"]) == ("gril-jax policy", 2)
    assert about["gril_jax"] == package_versions()["gril-jax"]
    assert about["layers"] == [
        {"in": own + 4, "out": 16, "activation": "swish"},
        {"in": 16, "out": 8, "activation": "swish"},
        {"in": 8, "out": 2 * task.env.action_size, "activation": "none"},
    ]
    assert about["output"] == {"mean": [0, 3], "spread": [3, 6], "squash": "tanh"}
    assert about["activity"] == {
        "start": own,
        "stop": own + 4,
        "objects": objects,
        "tau": 0.005,
        "window": 40,
        "smoothing": 1,
        "noise": None,
    }
    assert [e["name"] for e in about["observation"][-4:]] == [f"{o} has moved" for o in objects]
    assert about["control_hz"] == task.env.control_hz
    assert about["env"]["targets"] == ["green square"]
    assert about["env"]["episode_length"] == 10
    assert about["action"][-1]["stop"] == 3


def test_ranges_cover_every_input_and_action_once(task, exported):
    _, _, out = exported
    with np.load(out) as file:
        about = json.loads(str(file["description"]))
        inputs = len(file["observation_mean"])
    for entries, size in ((about["observation"], inputs), (about["action"], 3)):
        edges = [0, *(entry["stop"] for entry in entries)]
        assert [entry["start"] for entry in entries] == edges[:-1]
        assert edges[-1] == size


def test_an_export_reads_the_run_only_leaves_no_other_file_and_repeats_to_the_byte(exported):
    folder, _, out = exported
    before = sorted(p for p in folder.rglob("*"))
    again = ["--out", str(folder / "again")]
    assert main.main(["export", "--what", "policy", str(folder / "run"), *again]) == 0
    assert (folder / "again").read_bytes() == out.read_bytes()
    (folder / "again").unlink()
    assert sorted(p for p in folder.rglob("*")) == before


# --- folding


@pytest.mark.parametrize(
    ("bits", "hidden"),
    [(True, ()), (False, (8, 6, 4)), pytest.param(True, (8,), marks=pytest.mark.slow)],
)
def test_every_depth_with_and_without_activity_bits_acts_alike(bits, hidden, tmp_path):
    algorithm = _probe(bits=bits, hidden=hidden)
    state = _seasoned(_fresh(algorithm))
    policy = Policy(state.normalizer, state.params.policy)
    arrays = policy_file.policy_arrays(policy)
    objects = Probe.classes if bits else ()
    about = policy_file.describe(RunConfig(), algorithm.env, arrays, objects)
    assert (about["activity"] is None) == (not bits)
    policy_file.write(tmp_path / "policy.npz", arrays, about)
    assert _compare(algorithm, policy, load_policy(tmp_path / "policy.npz")) < 1e-5


def test_a_file_keeps_the_activity_rule_of_detected_boxes():
    pool = PoolConfig(window=7, noise=0.05)
    config = dataclasses.replace(RunConfig(), pool=pool)
    arrays = {"kernel_0": np.zeros((3, 2), np.float32)}
    about = policy_file.describe(config, Probe(), arrays, ["green star"])["activity"]
    assert policy_file.pool_of(about).rule() == pool.rule()
    assert about["smoothing"] == 3
    for wrong in ({"smoothing": 5}, {"tau": 0.1}, {"noise": -1.0}):
        with pytest.raises((ValueError, ConfigError), match=r"rule of activity|noise is"):
            policy_file.pool_of(about | wrong)


def test_folding_is_the_normalisation_in_float64():
    """The oracle: clip((x - mean) / std) W + b, written out for one layer."""
    algorithm = _probe(hidden=())
    state = _seasoned(_fresh(algorithm))
    found = policy_file.policy_arrays(Policy(state.normalizer, state.params.policy))
    layer = state.params.policy["params"]["hidden_0"]
    kernel, bias = (np.asarray(layer[name], np.float64) for name in ("kernel", "bias"))
    mean, std = (np.asarray(x, np.float64) for x in (state.normalizer.mean, state.normalizer.std))
    for offset in np.linspace(-12, 12, 25):
        x = mean + offset * std
        wanted = np.clip((x - mean) / std, -10, 10) @ kernel + bias
        limit = np.float64(found["observation_limit"])
        x = np.clip(x - mean, -limit, limit)
        np.testing.assert_allclose(x @ found["kernel_0"] + found["bias_0"], wanted, rtol=1e-6)


# --- names


class _Named(Probe):
    observation_names = ("sign", "constant")
    action_names = ("push",)


class _Misnamed(Probe):
    observation_names = ("sign",)
    action_names = ("push", "pull")


def test_numbers_have_the_task_s_own_names_and_equal_names_in_a_row_are_one_range():
    own = {"sign": (0, 1), "constant": (1, 2), "robot has moved": (2, 3)}
    for task, seen, acts in ((_Named(), own, "push"), (Probe(), {"observation": (0, 2)}, "action")):
        found = policy_file.observation_layout(task, ["robot"] if task.__class__ is _Named else [])
        assert {one["name"]: (one["start"], one["stop"]) for one in found} == seen
        action = {"name": acts, "start": 0, "stop": 1, "low": -1.0, "high": 1.0}
        assert policy_file.action_layout(task) == [action]


def test_names_that_do_not_fit_the_sizes_are_refused():
    with pytest.raises(ShapeError, match="names 1 numbers of its observation, but it has 2"):
        policy_file.observation_layout(_Misnamed())
    with pytest.raises(ShapeError, match="names 2 numbers of its action, but it has 1"):
        policy_file.action_layout(_Misnamed())


# --- what can go wrong at work


def _main(folder, out, algorithm):
    policy = policy_setup.restore_policy(folder, RunConfig(), algorithm)
    policy_file.save(out, RunConfig(), algorithm, policy)


def test_a_run_without_policy_is_refused(tmp_path):
    run_dir.create(tmp_path / "run", RunConfig(), device="cpu").close()
    with pytest.raises(RunError, match="has no policy, so its run has not got that far yet"):
        _main(tmp_path / "run", tmp_path / "policy.npz", _probe())


def test_a_policy_that_is_not_finite_is_refused(tmp_path):
    algorithm = _probe()
    state = _fresh(algorithm)
    broken = jax.tree.map(lambda x: jnp.asarray(np.full(x.shape, np.nan, np.float32)),
                          state.params.policy)  # fmt: skip
    state = state._replace(params=state.params.replace(policy=broken))
    _save_run(tmp_path / "run", algorithm, RunConfig(), state=state)
    with pytest.raises(RunError, match="kernel_0 of the policy is not finite"):
        _main(tmp_path / "run", tmp_path / "policy.npz", algorithm)
    assert not (tmp_path / "policy.npz").exists()


def test_a_policy_of_another_shape_is_refused(tmp_path):
    _save_run(tmp_path / "run", _probe(hidden=(4,)), RunConfig())
    with pytest.raises(RunError, match="hidden_"):
        _main(tmp_path / "run", tmp_path / "policy.npz", _probe(hidden=(8, 6)))


def test_the_newest_policy_is_exported(tmp_path):
    algorithm = _probe()
    old = _save_run(tmp_path / "run", algorithm, RunConfig())
    new = _seasoned(old, seed=5)
    checkpoint.save(tmp_path / "run" / "policy", 1280, algorithm.policy(new))
    _main(tmp_path / "run", tmp_path / "policy.npz", algorithm)
    with np.load(tmp_path / "policy.npz") as file:
        np.testing.assert_array_equal(file["observation_mean"], new.normalizer.mean)


def test_a_file_that_came_in_between_is_not_overwritten(tmp_path):
    out = tmp_path / "policy.npz"
    out.write_text("precious")
    with pytest.raises(RunError, match="exists already: name a new file"):
        policy_file.write(out, {}, {})
    assert [p.name for p in tmp_path.iterdir()] == ["policy.npz"]
    assert out.read_text() == "precious"


def test_a_write_that_fails_leaves_nothing(tmp_path, monkeypatch):
    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(RunError, match="there is no space left to write to"):
        policy_file.write(tmp_path / "policy.npz", {}, {})
    assert [*tmp_path.iterdir()] == []


def test_a_folder_that_has_gone_is_one_sentence(tmp_path):
    with pytest.raises(RunError, match=r"gone cannot be written to \(No such file or directory\)"):
        policy_file.write(pathlib.Path(tmp_path / "gone" / "policy.npz"), {}, {})


@pytest.mark.parametrize(
    ("observation", "told", "bits"),
    [
        ("rich", None, True),
        ("xmagical", None, False),
        ("xmagical", True, True),
        ("rich", False, False),
    ],
)
@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_x_magical_s_vector_stays_alone_unless_activity_bits_are_asked_for(
    observation, told, bits, algorithm
):
    config = dataclasses.replace(
        SMALL,
        env=dataclasses.replace(SMALL.env, observation=observation),
        ppo=dataclasses.replace(SMALL.ppo, observe_activity=told),
        sac=dataclasses.replace(SMALL.sac, observe_activity=told),
        run=dataclasses.replace(SMALL.run, algorithm=algorithm),
    )
    env = setup.make_env(config.env, training=True)
    episodes = policy_setup.make_algorithm(config, env).episodes
    objects = 2 + len(config.env.targets) + len(config.env.distractors)
    own = len(jax.eval_shape(env.reset, jax.random.key(0)).obs)
    assert episodes.observation_size == own + bits * objects
