"""Our side of the comparison with brax's PPO: `train` has the shape of `bench_stock.train`."""

import time
from collections.abc import Callable
from functools import partial

import jax
import numpy as np

from gril_jax.rl import ppo, rewards, training

from .bench_pendulum import Pendulum, Setting

__all__ = ["chunks", "train"]


def chunks(setting: Setting):
    """The algorithm, its hyper-parameters, and the one program: (state, count, examine) -> all."""
    static = ppo.Static(
        num_envs=setting.num_envs,
        unroll_length=setting.unroll_length,
        num_minibatches=setting.num_minibatches,
        num_epochs=setting.num_epochs,
        hidden=setting.hidden,
        observe_activity=False,
        window=1,
    )
    task = Pendulum()
    algorithm = ppo.PPO(task, rewards.environmental, static)
    hyper = ppo.Hyper(
        learning_rate=setting.learning_rate,
        discounting=setting.discounting,
        gae_lambda=setting.gae_lambda,
        entropy_cost=setting.entropy_cost,
        clipping_epsilon=setting.clipping_epsilon,
        reward_scaling=setting.reward_scaling,
        max_grad_norm=setting.max_grad_norm,
    )

    @partial(jax.jit, donate_argnums=0)
    def run(state, count, examine):
        return training.chunk(
            algorithm, state, hyper, None, updates=setting.updates, evaluation=(task,),
            count=count, examine=examine,
        )  # fmt: skip

    @jax.jit
    def init(seed):
        return algorithm.init(jax.random.key(seed), hyper)

    return init, run


def train(
    seed: int, setting: Setting, progress: Callable[[int, float, float], None] = lambda *_: None
) -> list[float]:
    """Returns of sampled actions at each evaluation.

    Args:
      seed: of the run.
      setting: hyper-parameters and length.
      progress: called after each evaluation with the steps so far, the return, and the steps a
        second of the part before it, evaluation included.
    """
    init, run = chunks(setting)
    state = init(seed)
    returns: list[float] = []
    for part in range(setting.num_evals):
        start = time.perf_counter()
        count = setting.updates if part else 0
        state, _, scores = run(state, np.int32(count), np.bool_(True))
        returns.append(float(np.asarray(scores.reward)[0, 1]))  # jax's own index compiles
        steps = count * setting.num_envs * setting.unroll_length
        progress(part * steps, returns[-1], steps / (time.perf_counter() - start))
    return returns
