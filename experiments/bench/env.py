"""Control steps per second of a task, random actions in parallel episodes, as JSON.

    gril bench env                      MatchRegions with the default setting
    gril bench env --settings True      what each setting of the solver gives, and the MJX engine
    gril bench env --task shoes_in_box --settings True   the same there, and MuJoCo Warp if it is
                                        installed

Throughput is the best of `repeats` runs of a compiled scan; compile time is that of the scan; and
`finite` is the share of episodes whose numbers all are, after these steps. On 2 CPU cores a case of
MatchRegions takes about 15 s, on one H200 about 20 s; one of the shoes compiles for longer.
"""

import contextlib
import importlib.util
import io
import json
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.experiments.pipeline import setup

from gril_jax import envs

__all__ = ["main", "measure"]


def measure(task: str, lanes: int, steps: int, repeats: int, **options) -> dict:
    """Steps per second and compile time of one setting."""
    if options.get("impl") == "warp":
        setup.quieten_warp()
        options = {**options, "worlds": lanes}
    with contextlib.redirect_stdout(io.StringIO()):  # mjx reports on optional parts
        env = envs.make(task, **options)
    reset = jax.jit(jax.vmap(env.reset))
    state = reset(jax.random.split(jax.random.key(0), lanes))

    def play(state, key):
        def move(state, key):
            action = jax.random.uniform(key, (lanes, env.action_size), minval=-1.0)
            return jax.vmap(env.step)(state, action), None

        return jax.lax.scan(move, state, jax.random.split(key, steps))[0]

    start = time.perf_counter()
    compiled = jax.jit(play).lower(state, jax.random.key(0)).compile()
    compile_s = time.perf_counter() - start
    state = jax.block_until_ready(compiled(state, jax.random.key(0)))
    best = float("inf")
    for number in range(repeats):
        start = time.perf_counter()
        state = jax.block_until_ready(compiled(state, jax.random.key(number)))
        best = min(best, time.perf_counter() - start)
    return {
        "options": options,
        "lanes": lanes,
        "control_steps_per_s": round(lanes * steps / best),
        "compile_s": round(compile_s, 2),
        "finite": _finite(state),
    }


def _finite(states: Any) -> float:
    """Share of lanes."""
    leaves = [np.asarray(x) for x in jax.tree.leaves(states)]
    found = [np.isfinite(x).reshape(len(x), -1).all(1) for x in leaves if x.dtype == jnp.float32]
    return float(np.all(found, axis=0).mean())


def main(
    lanes: int | None,
    steps: int,
    repeats: int,
    *,
    task: str,
    settings: bool,
    echo: Callable[[str], None],
) -> None:
    """Echo the figures as JSON."""
    spec = envs.spec(task)
    lanes = lanes or (256 if jax.default_backend() == "cpu" else spec.bench_envs)
    cases = spec.bench_settings if settings else ({},)
    if importlib.util.find_spec("warp") is None:
        cases = [case for case in cases if case.get("impl") != "warp"]
    figures = [measure(task, lanes, steps, repeats, **case) for case in cases]
    result = {
        "task": task,
        "device": setup.device_in_words(),
        "jax": jax.__version__,
        "cases": figures,
    }
    echo(json.dumps(result, indent=2))
