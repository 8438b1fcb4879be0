"""Our side of the comparison with brax's PPO and SAC: `train` has the interface of brax's.

Seeds can be vmapped over: `chunks` hands out pure functions.
"""

import inspect
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import jax
import numpy as np
from gril_jax.envs import Env

from gril_jax.compilation.compiler import compiled
from gril_jax.rl import ppo, rewards, sac, training

from .pendulum import Pendulum, SacSetting, Setting

_SEEING = {"observe_activity": False, "window": 1}
_FIXED = {  # brax's SAC has no options for these
    "alpha_learning_rate": 3e-4, "initial_alpha": 1.0, "target_entropy": -0.5,
    "max_grad_norm": float("inf"),
}  # fmt: skip


def chunks(setting: Setting | SacSetting, task: Env | None = None):
    """Two programs: seed -> state, and (state, count, examine) -> what `chunk` returns."""
    task = Pendulum() if task is None else task
    of, fixed = (sac.SAC, _FIXED) if isinstance(setting, SacSetting) else (ppo.PPO, {})
    chosen = vars(setting) | _SEEING | fixed
    hyper, static = (
        kind(**{k: chosen[k] for k in inspect.signature(kind).parameters if k in chosen})
        for kind in (of.Hyper, of.Static)
    )
    algorithm = of(task, rewards.environmental, static)

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
    """Returns of PPO's sampled actions on the pendulum at each evaluation.

    `progress` is as that of `stock.train`, but its steps a second include the evaluation.
    """
    init, run = chunks(setting)
    with ThreadPoolExecutor(1) as thread:  # as `gril_jax.compilation.sharding` does
        begun = init.trace(seed)
        ready = thread.submit(compiled, begun.lower())
        run = compiled(run.lower(begun.out_info, np.int32(0), np.bool_(True)))
        state = ready.result()(seed)
    returns: list[float] = []
    for part in range(setting.num_evals):
        start = time.perf_counter()
        count = setting.updates if part else 0
        state, _, scores = run(state, np.int32(count), np.bool_(True))
        returns.append(float(np.asarray(scores.reward)[0, 1]))  # jax's own index compiles
        steps = count * setting.num_envs * setting.unroll_length
        progress(part * steps, returns[-1], steps / (time.perf_counter() - start))
    return returns


def all_returns(
    setting: Setting | SacSetting, task: Env, seeds: int, episodes: int
) -> list[list[float]]:
    """Returns of mean actions, per seed one at each evaluation; all seeds run in one program.

    The last one's is the mean over so many `episodes`, the others' over half the environments'.
    """
    init, run = chunks(setting, task)
    state = jax.vmap(init)(np.arange(seeds))
    run = jax.jit(jax.vmap(run, in_axes=(0, None, None)), donate_argnums=0)

    def examined(updates: int):
        nonlocal state
        state, _, scores = run(state, np.int32(updates), np.bool_(True))
        return np.asarray(scores.reward)[:, 0, 0]

    returns = [examined(setting.updates if part else 0) for part in range(setting.num_evals)]
    again = [returns[-1]]
    for number in range(1, -(-episodes // (setting.num_envs // 2))):  # training is over: other keys
        state = state._replace(key=jax.vmap(jax.random.fold_in, (0, None))(state.key, number))
        again.append(examined(0))
    returns[-1] = np.mean(again, axis=0)
    return np.stack(returns, axis=1).tolist()
