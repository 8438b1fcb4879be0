"""Distinct starts are counted from the states after a reset, whatever the task."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs import registry

from gril_jax.config import EnvConfig
from gril_jax.rl import rewards
from gril_jax.rl.episodes import Episodes
from gril_jax.workflows.build import setup
from gril_jax.workflows.build.starts import Group, draw, evaluated_from, which

ONE_BLOCK = EnvConfig(targets=("green square",), distractors=("yellow circle",))


@pytest.mark.parametrize(("variant", "count"), [("demo", 1), ("jitter", 12), ("layout", 12)])
def test_a_variant_s_starts_are_counted(variant, count):
    env = setup.make_env(ONE_BLOCK, training=False)
    episodes = Episodes.of(env, rewards.environmental)
    group = draw(ONE_BLOCK, variant, episodes, jax.random.key(0), count=12)
    assert group.count == count
    assert len(group.start) == len(group.begun.time) == 12


def test_equal_rows_are_one_start_and_keys_tell_nothing():
    place = np.array([[0.5, 1.0], [0.25, 1.0], [0.5, 1.0], [0.5 + 1e-8, 1.0]], np.float64)
    older = jnp.arange(8, dtype=jnp.uint32).reshape(4, 2)
    states = {"place": place, "key": jax.random.split(jax.random.key(0), 4), "old": older}
    first, second, *others = which(states)
    assert first != second
    assert others == [first, first]
    assert len({*which(states | {"count": jnp.arange(4)}).tolist()}) == 4


def test_each_distinct_start_counts_once():
    group = Group("", None, np.array([0, 1, 0, 0]))
    assert group.share(np.array([1.0, 0.0, 1.0, 1.0, 9.0])) == 0.5


def test_a_task_says_which_variants_stand_for_what():
    def found(variant):
        return tuple(evaluated_from(EnvConfig(variant=variant)))

    assert found("demo") == ("demo", "jitter", "layout")
    assert found("jitter") == ("jitter", "jitter", "layout")
    assert found("layout") == ("layout", "layout", None)
    assert found("shape") == ("shape", "shape", None)
    assert tuple(evaluated_from(EnvConfig(name="shoes_in_box"))) == (None, None, None)
    for name in registry.names():
        task = registry.spec(name)
        assert {*task.many_starts, *task.elsewhere} <= {"demo", "jitter"}
