"""Both algorithms on a classic whose good returns are known."""

import jax
import jax.numpy as jnp
import pytest
from support.pendulum import Pendulum

from gril_jax.rl import ppo, rewards, sac, training

SEEING = {"hidden": (64, 64), "observe_activity": False, "window": 1}
PPO = ppo.Static(num_envs=64, unroll_length=50, num_minibatches=8, num_epochs=8, **SEEING)
SAC = sac.Static(
    num_envs=8, unroll_length=2, updates_per_step=16, batch_size=128, replay_size=16 * 1000,
    min_replay=1600, **SEEING,
)  # fmt: skip
RATES = {"learning_rate": 1e-3, "reward_scaling": 0.1}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("algorithm", "hyper", "updates"),
    [
        (ppo.PPO(Pendulum(), rewards.environmental, PPO),
         ppo.Hyper(discounting=0.95, entropy_cost=1e-3, **RATES), 40),
        (sac.SAC(Pendulum(), rewards.environmental, SAC),
         sac.Hyper(discounting=0.98, soft_update=0.01, initial_alpha=0.2,
                   alpha_learning_rate=1e-3, **RATES), 500),
    ],
    ids=["ppo", "sac"],
)  # fmt: skip
def test_the_pendulum_is_swung_up_and_held(algorithm, hyper, updates):
    """128,000 control steps of PPO, 8,000 of SAC; an untrained policy gets about -1,200."""
    hyper = jax.tree.map(jnp.float32, hyper)

    @jax.jit
    def run(key):
        state = algorithm.init(key, hyper)
        return training.chunk(
            algorithm, state, hyper, None, updates=updates, evaluation=(Pendulum(),)
        )

    _, _, scores = run(jax.random.key(0))
    assert float(scores.reward[0, 0]) > -300
    assert float(scores.success[0, 0]) > 0.9  # upright at the end
