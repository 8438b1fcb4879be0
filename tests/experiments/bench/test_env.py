"""What the benchmark of the tasks steps: settings that exist, and states that are finite."""

import inspect
import typing

import jax.numpy as jnp
import pytest
from gril_jax.envs.magical.match_regions.task import MatchRegions
from gril_jax.envs.tabletop.task import Tabletop
from gril_jax.experiments.bench import env as bench_env

from gril_jax.config import TaskName


@pytest.mark.parametrize(
    ("task", "kind"), [("match_regions", MatchRegions), ("shoes_in_box", Tabletop)]
)
def test_every_setting_is_an_option_of_its_task(task, kind):
    known = set(inspect.signature(kind.__init__).parameters)
    assert all(set(options) <= known for options in bench_env.SETTINGS[task])
    assert set(bench_env.SETTINGS) == set(bench_env._NUM_ENVS) == set(typing.get_args(TaskName))


def test_an_episode_with_a_number_that_is_not_finite_does_not_count():
    states = {"x": jnp.ones((4, 3)).at[1, 2].set(jnp.nan), "n": jnp.arange(4)}
    assert bench_env._finite(states) == 0.75
    assert bench_env._finite(states | {"y": jnp.ones(4).at[3].set(jnp.inf)}) == 0.5
