"""The table of tasks: each entry's parts, the contract that every task keeps, and a new task."""

import inspect
import subprocess
import sys
import textwrap

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs import registry

from gril_jax import envs
from gril_jax.cli import main
from gril_jax.config import EnvConfig
from gril_jax.config.files import load
from gril_jax.demos.demo_set import load_demo_set
from gril_jax.errors import ConfigError


@pytest.fixture(params=envs.names())
def name(request):
    return request.param


# ---------------------------------------------------------------- entries


def test_the_parts_of_an_entry_exist(name):
    spec, known = envs.spec(name), envs.options(name)
    assert callable(envs.demonstrate(name))
    assert all(set(options) <= known for options in spec.bench_settings)
    assert {"reward", "episode_length"} <= known
    assert load(name).env.name == name  # one YAML file of its name


def test_the_first_reward_is_the_constructors_own(name):
    make = envs.make(name)
    default = inspect.signature(type(make)).parameters["reward"].default
    assert default == envs.spec(name).rewards[0]


def test_entries_are_read_before_anything_heavy_is_imported():
    code = (
        "import sys, gril_jax.envs as e; [e.spec(n) for n in e.names()]; "
        "assert not {'jax', 'mujoco', 'numpy'} & {*sys.modules}"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


# ---------------------------------------------------------------- the contract


def _same_types(first, after):
    """Weak types too: one that changes would make a jitted step compile twice."""
    assert jax.tree.leaves(first) == jax.tree.leaves(after)
    assert jax.tree.structure(first) == jax.tree.structure(after)
    assert all(not leaf.weak_type for leaf in jax.tree.leaves(after))


@pytest.fixture
def task(name):
    return envs.make(name)


def test_task_keeps_the_contract(task):
    assert isinstance(task, envs.Env)
    key, action = jax.random.key(0), jnp.zeros(task.action_size)
    first = jax.eval_shape(task.reset, key)
    after = jax.eval_shape(task.step, first, action)
    _same_types(first, after)
    assert first.obs.shape == (task.observation_size,)
    count = first.objects.label.shape[0]
    assert first.moved.shape == first.objects.is_robot.shape == (count,)
    assert first.objects.center.shape == first.objects.size.shape == (count, 2)
    assert {"score", "success"} <= set(first.metrics)
    assert task.episode_length > 0
    assert task.control_hz > 0
    assert task.half_extent > 0


def test_task_starts_where_its_key_says(task):
    reset = jax.jit(task.reset)
    a, b = reset(jax.random.key(3)), reset(jax.random.key(3))
    chex.assert_trees_all_equal(a, b)
    label = np.asarray(a.objects.label)
    assert label.min() >= 0
    assert label.max() < len(task.classes)
    assert tuple(np.flatnonzero(a.objects.is_robot)) == task.stages.robots != ()


# ---------------------------------------------------------------- a new task

TASK = """
    import jax
    import jax.numpy as jnp
    import numpy as np
    from gril_jax.envs.base import Demonstrations, Episode, Film, Objects, Outline, State


    class Reach:
        classes = ("goal", "robot")
        observation_size, action_size = 2, 2
        control_hz, half_extent, background = 10.0, 1.0, (255, 255, 255)
        stages = None

        def __init__(self, *, reward: str = "near", episode_length: int = 20):
            self.episode_length = episode_length

        def reset(self, key):
            return self._state(jax.random.uniform(key, (2,), minval=-0.8, maxval=0.8))

        def step(self, state, action):
            return self._state(jnp.clip(state.data + 0.1 * action, -1.0, 1.0))

        def _state(self, place):
            away = jnp.sqrt(jnp.sum(place**2) + 1e-9)
            success = (away < 0.2).astype(jnp.float32)
            none, size = jnp.zeros(2), jnp.full((2, 2), 0.2)
            objects = Objects(
                jnp.stack([none, place]), size, jnp.arange(2), jnp.array([False, True])
            )
            metrics = {"score": success, "success": success, "varied": 0 * success}
            still = jnp.zeros(2, bool)
            return State(place, place, objects, still, -away, jnp.zeros(()), metrics)

        def outlines(self, data):
            box = 0.1 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
            return [Outline(box + np.asarray(at), (9, 9, 9), None) for at in (np.zeros(2), data)]


    def demonstrate(make, wanted, tell):
        env, rng = make(), np.random.default_rng(wanted.seed)
        ends = ["success"] * wanted.successes + ["failure"] * wanted.failures
        begins = rng.uniform(0.3, 0.8, (len(ends), 2))
        tell(len(ends))
        return Demonstrations(
            env, env.classes, [Episode(end, end, None) for end in ends],
            (film(begin, end) for begin, end in zip(begins, ends)),
        )


    def film(begin, end):
        way = np.linspace(begin, begin * (end == "failure"), 12)
        center = np.stack([0 * way, way], axis=1).astype(np.float32)
        size = np.full(center.shape, 0.2, np.float32)
        return Film(np.zeros((12, 16, 16, 3), np.uint8), center, size, np.ones((12, 2), bool))
"""
SPEC = """
    from gril_jax.envs import TaskSpec

    SPEC = TaskSpec(
        make="reach_task.task:Reach", demonstrate="reach_task.task:demonstrate", rewards=("near",)
    )
"""
CONFIG = """
    env: {name: reach, episode_length: 12}
    demos: {num: 4, num_validation: 2, num_failures: 1}
    encoder: {width: 8, latent: 4, pool_robot: true, robot_messages: true}
    pretrain: {steps: 4, num_videos: 3, num_frames: 6}
    ppo: {num_envs: 8, unroll_length: 4, num_timesteps: 64, num_minibatches: 2, hidden: [8]}
    run: {eval_episodes: 2, evaluations: 0, updates_per_chunk: 1}
"""


@pytest.fixture
def reach(tmp_path, monkeypatch):
    """A task's folder, its line in the table, and its YAML file."""
    folder = tmp_path / "reach_task"
    folder.mkdir()
    (folder / "__init__.py").write_text(textwrap.dedent(SPEC))
    (folder / "task.py").write_text(textwrap.dedent(TASK))
    (tmp_path / "reach.yaml").write_text(textwrap.dedent(CONFIG))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(registry.TASKS, "reach", "reach_task:SPEC")
    yield tmp_path
    for module in ("reach_task", "reach_task.task"):
        sys.modules.pop(module, None)


def test_a_new_task_is_trained_by_the_command_line(reach):
    out = reach / "run"
    assert main.main(["train", str(reach / "reach.yaml"), "--out", str(out)]) == 0
    assert (out / "report.html").is_file()
    demos = load_demo_set(out / "demos")
    assert (demos.task, demos.classes) == ("reach", ("goal", "robot"))
    assert [e.outcome for e in demos.entries] == ["success"] * 6 + ["failure"]
    assert main.main(["eval", str(out)]) == 0


def test_a_task_of_another_package_needs_no_line_in_the_table(reach, monkeypatch):
    monkeypatch.delitem(registry.TASKS, "reach")
    with pytest.raises(ConfigError, match="there is no task 'reach'"):
        load(str(reach / "reach.yaml"))
    config = EnvConfig(name="reach_task:SPEC", reward="near")
    assert envs.make(config.name).classes == ("goal", "robot")
    with pytest.raises(ConfigError, match="there is no task 'reach_task:NONE'"):
        EnvConfig(name="reach_task:NONE")
    with pytest.raises(ConfigError, match="reach_task:TaskSpec is a type, but a"):
        EnvConfig(name="reach_task:TaskSpec")
