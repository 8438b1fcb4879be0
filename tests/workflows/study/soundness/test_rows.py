"""The rows of an ablation of soundness: what they change, and what is refused."""

import dataclasses

import pytest

from gril_jax.config import RunConfig
from gril_jax.errors import ConfigError
from gril_jax.workflows.build import setup
from gril_jax.workflows.study.rows import changed
from gril_jax.workflows.study.soundness.rows import ROWS, with_budget


def test_every_row_is_a_training_of_its_own():
    trainings = [
        (setup.pretrain_config(config, 7), setup.pretrain_hyper(config))
        for config in (changed(RunConfig(), change) for change in ROWS.values())
    ]
    assert all(trainings.count(one) == 1 for one in trainings)


def test_every_row_sets_the_same_fields():
    assert len({frozenset(change) for change in ROWS.values()}) == 1


def test_a_budget_is_that_of_the_algorithm_that_trains():
    assert with_budget(RunConfig(), 5000).ppo.num_timesteps == 5000
    run = dataclasses.replace(RunConfig().run, algorithm="sac")
    assert with_budget(RunConfig(run=run), 5000).sac.num_timesteps == 5000
    assert with_budget(RunConfig(), None) == with_budget(RunConfig(), 0) == RunConfig()


def test_a_budget_below_one_update_and_another_reward_are_refused():
    with pytest.raises(ConfigError, match=r"ppo\.num_timesteps is 5, but must cover one update"):
        with_budget(RunConfig(), 5)
    run = dataclasses.replace(RunConfig().run, reward="shaped")
    with pytest.raises(ConfigError, match=r"run\.reward is 'shaped', but must be 'learned'"):
        with_budget(RunConfig(run=run), None)
