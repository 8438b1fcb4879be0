"""The table of tasks: each entry's parts, the contract that every task keeps, and a new task."""

import inspect
import subprocess
import sys

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import new_task

from gril_jax import envs
from gril_jax.config import EnvConfig
from gril_jax.config.files import load
from gril_jax.errors import ConfigError

ONE_OF_EACH_KIND = {"match_regions", "find_dupe", "shoes_in_box", "item_in_drawer"}
ALL = [
    name if name in ONE_OF_EACH_KIND else pytest.param(name, marks=pytest.mark.slow)
    for name in envs.names()
]


@pytest.fixture(params=envs.names())
def name(request):
    return request.param


# ---------------------------------------------------------------- entries


def test_the_parts_of_an_entry_exist(name):
    spec, known = envs.spec(name), envs.options(name)
    assert not spec.demonstrate or callable(envs.demonstrate(name))
    assert {"reward", "episode_length"} <= known
    first = load(spec.config or name).env.name  # of a YAML file of its name, or of a shared one
    assert first == name or envs.spec(first).config == spec.config


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


@pytest.fixture(params=ALL)
def task(request):
    return envs.make(request.param)


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
    robots = tuple(np.flatnonzero(a.objects.is_robot))
    assert robots == task.stages.robots
    assert robots or task.stages.stages[0].moves == (0,)  # a robot that is what has to move counts


# ---------------------------------------------------------------- a new task (see test_adding)


@pytest.fixture
def reach(tmp_path, monkeypatch):
    """A task's folder and its YAML file, without a line in the table."""
    new_task.write(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    for module in ("reach_task", "reach_task.task"):
        sys.modules.pop(module, None)


def test_a_task_of_another_package_needs_no_line_in_the_table(reach):
    with pytest.raises(ConfigError, match="there is no task 'reach'"):
        load(str(reach / "reach.yaml"))
    config = EnvConfig(name="reach_task:SPEC", reward="near")
    assert envs.make(config.name).classes == ("goal", "robot")
    with pytest.raises(ConfigError, match="there is no task 'reach_task:NONE'"):
        EnvConfig(name="reach_task:NONE").check()
    with pytest.raises(ConfigError, match="reach_task:TaskSpec is a type, but a"):
        EnvConfig(name="reach_task:TaskSpec").check()
