"""PPO's throughput for `gril bench train`: seeds in one program or apart, one device or all."""

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gril_jax.compilation import sharding
from gril_jax.rl import ppo, training

from .frame import compile_timed, ratios, rounded, speeds, without_cache


def seeds(algorithm: training.Algorithm, num: int, updates: int, separate: int) -> dict[str, Any]:
    """Times seeds in one program, and one by one, of which the first `separate` are really run."""
    keys = jax.block_until_ready(jax.random.split(jax.random.key(0), num))
    with without_cache():
        together = _whole(jax.vmap, algorithm, keys, updates)
        alone = [_whole(lambda f: f, algorithm, key, updates) for key in keys[:separate]]
    each = {name: sum(part[name] for part in alone) / len(alone) for name in together}
    apart = {name: num * value for name, value in each.items()}
    return {
        "seeds": num,
        "steps_of_a_seed": updates * algorithm.num_envs * algorithm.unroll_length,
        "together_s": rounded(together),
        "one_by_one_s": rounded(apart),
        "one_by_one": f"{len(alone)} measured, times {num / len(alone):g}",
        "times_as_fast": round(sum(apart.values()) / sum(together.values()), 2),
        "times_as_fast_to_run": round(apart["run"] / together["run"], 2),
    }


def _whole(mapped, algorithm: training.Algorithm, key: Any, updates: int) -> dict[str, float]:
    """Seconds of a whole training in a fresh Python process."""
    jax.clear_caches()
    hyper = ppo.Hyper()

    def run(state):
        return training.chunk(algorithm, state, hyper, None, updates=updates)[0]

    start = time.perf_counter()
    state = jax.jit(mapped(partial(algorithm.init, hyper=hyper)))(key)
    advance, _ = compile_timed(mapped(run), state, donate_argnums=0)
    jax.block_until_ready(state)
    compiled = time.perf_counter()
    jax.block_until_ready(advance(state))
    return {"compile": compiled - start, "run": time.perf_counter() - compiled}


def devices(
    make: Callable[[int], training.Algorithm], num_envs: int, updates: int, repeats: int
) -> dict[str, Any] | None:
    """One device and all, with as many environments on each; None where there is only one."""
    every = jax.devices()
    if len(every) == 1:
        return None
    small, large = make(num_envs), make(len(every) * num_envs)
    cases = {
        "one": (small, every[:1], 1),
        "all_one_seed": (large, every, 1),
        "all_a_seed_each": (small, every, len(every)),
    }
    calls = {name: _spread(*case, updates) for name, case in cases.items()}
    steps = {
        name: count * updates * algorithm.num_envs * algorithm.unroll_length
        for name, (algorithm, _, count) in cases.items()
    }
    speed = speeds(calls, steps, repeats)
    return {
        "devices": len(every),
        "environments_on_each": num_envs,
        "steps_per_s": rounded(speed, 0),
        "times_one": ratios(speed, "one"),
    }


def _spread(algorithm: training.Algorithm, on: Sequence[Any], count: int, updates: int):
    layout = sharding.mesh(on, seeds=count, num_envs=algorithm.num_envs)
    each = jax.tree.map(lambda x: jnp.full((count,), x, jnp.float32), ppo.Hyper())
    hyper = sharding.place(layout, each)
    keys = jax.random.split(jax.random.key(0), count)
    state = sharding.init(algorithm, layout, keys, hyper)
    run = sharding.advance(algorithm, layout, state, updates)

    def call():
        nonlocal state
        state, _ = run(state, hyper, None, np.int32(updates), np.bool_(True))
        return state

    return call
