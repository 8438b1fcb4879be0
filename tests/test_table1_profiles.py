"""Rewards along demonstrations beside one encoder after the other."""

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.experiments import setup
from gril_jax.experiments.demonstrations import Demonstrations
from gril_jax.experiments.named_rows import changed
from gril_jax.experiments.sweep_rewards import LearnedReward
from gril_jax.experiments.sweep_rows import Row
from gril_jax.experiments.table1_profiles import measure
from kinematic_demos import kinematic_demos

from gril_jax import pretrain
from gril_jax.config import RunConfig
from gril_jax.cycle_metrics import two_way_cycle_consistency
from gril_jax.reward import RewardParams

SMALL = {"encoder.width": 4, "encoder.rounds": 0, "encoder.latent": 3, "pool.window": 3}


def test_cycle_consistency_is_that_of_each_encoder_and_profiles_are_those_of_the_first():
    config = changed(RunConfig(), SMALL)
    batch = jax.tree.map(jnp.asarray, kinematic_demos(0, 3, num_objects=4, max_length=14))
    batch = batch._replace(length=jnp.array([14, 9, 12]))
    learned = []
    for seed in range(2):
        draw = np.random.default_rng(seed)
        blank = setup.blank_reward(config, 4).encoder
        encoder = jax.tree.map(
            lambda x, d=draw: jnp.asarray(d.normal(size=x.shape), x.dtype), blank
        )
        goal = jnp.asarray(draw.normal(size=3), jnp.float32)
        one = RewardParams(encoder, goal, jnp.float32(0.5), jnp.float32(5.0))
        learned.append(LearnedReward(one, 0.0, batch, 4))

    class Made(Demonstrations):
        def batch(self, split):
            return batch

    found = measure(Row(0, 0, config), learned, Made(None, {"failure": []}, 0))

    static, hyper = setup.pretrain_config(config, 4), setup.pretrain_hyper(config)
    latents = [pretrain.embed(one.params.encoder, batch, hyper, static) for one in learned]
    cycle = [float(two_way_cycle_consistency(x, batch.length)) for x in latents]
    np.testing.assert_allclose(found["cycle"], cycle, atol=1e-6)
    rewards = -0.5 * np.linalg.norm(latents[0] - learned[0].params.goal, axis=-1)
    for i, values in enumerate(found["success"]):
        np.testing.assert_allclose(values, rewards[i, : batch.length[i]], atol=2e-3)
    assert [len(values) for values in found["success"]] == [14, 9, 12]
    assert found["failure"] == []
