"""The ablation of encoder training: rows that differ where their names say, and their measure."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.kinematic_demos import kinematic_demos

from gril_jax.config import RunConfig
from gril_jax.encoders import encoder
from gril_jax.pretraining import pretrain
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.workflows.build import setup
from gril_jax.workflows.build.demonstrations import Demonstrations
from gril_jax.workflows.study.ablate.ablate import TABLE
from gril_jax.workflows.study.ablate.rows import ROWS
from gril_jax.workflows.study.results import Found
from gril_jax.workflows.study.rewards import TrainedReward
from gril_jax.workflows.study.rows import changed

SMALL = {"encoder.width": 8, "encoder.rounds": 1, "encoder.latent": 4}
CONFIG = changed(RunConfig(), SMALL)


def test_every_row_but_the_first_changes_the_training():
    def training(change):
        config = changed(CONFIG, change)
        return setup.pretrain_config(config, 7), setup.pretrain_hyper(config)

    same = [name for name, change in ROWS.items() if training(change) == training({})]
    assert same == ["as configured", "1 round of messages"]  # that is this test's configuration


@pytest.mark.slow
def test_the_measure_of_many_encoders_is_that_of_each():
    train = jax.tree.map(jnp.asarray, kinematic_demos(0, 4, num_objects=5))

    class Made(Demonstrations):
        def batch(self, split):
            return train

    demo_set = type("Set", (), {"classes": (*"abcdefg",)})
    (measure,) = TABLE.measures(CONFIG, None, Made(demo_set, {}, 0))
    static = setup.pretrain_config(CONFIG, 7)
    keys = jax.random.split(jax.random.key(0))
    each = [encoder.init(key, static.encoder) for key in keys]
    params = [RewardParams(one, jnp.ones(4), jnp.ones(()), jnp.float32(5.0)) for one in each]
    rewards = [TrainedReward(one, 0.0, train, 7) for one in params]
    config = changed(CONFIG, {"pool.alpha": 20.0})
    found = measure.measure(measure.compile(CONFIG, 2), config, rewards)
    alone = pretrain.evaluate(each[1], train, train, setup.pretrain_hyper(config), static)
    for name, values in found.items():
        np.testing.assert_allclose(values[1], alone[name], rtol=1e-3)


def test_the_table_has_mean_and_range():
    numbers = dict.fromkeys(("tau", "reward_time_tau", "reward_last"))
    lines = [
        {"row": "a case", "seed": k} | dict.fromkeys(numbers, x) for k, x in enumerate((0.1, 0.3))
    ]
    assert "| a case | 2 | 0.200 (0.100 to 0.300) |" in TABLE.text(Found([], lines, [], {}, {}))
