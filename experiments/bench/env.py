"""Control steps per second of a task, random actions in parallel episodes.

    gril bench env                      MatchRegions with the default setting
    gril bench env --settings True      what each setting of the solver gives, and the MJX engine
    gril bench env --task shoes_in_box --settings True   the same there, and Warp if installed

Throughput is the best of some runs of a compiled scan, and `finite` the share of episodes whose
numbers all are. A case of MatchRegions takes about 15 s on 2 CPU cores, one of the shoes longer.
"""

import importlib.util
import itertools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.experiments.pipeline import setup

from gril_jax import envs

from .frame import compile_timed, speeds

_REPEATS = 5


def main(*, task: str, num_envs: int | None, steps: int, settings: bool) -> dict[str, Any]:
    """The figures of the default setting, or of every one."""
    spec = envs.spec(task)
    num_envs = num_envs or (256 if jax.default_backend() == "cpu" else spec.bench_envs)
    cases = spec.bench_settings if settings else ({},)
    if importlib.util.find_spec("warp") is None:
        cases = [case for case in cases if case.get("impl") != "warp"]
    return {"task": task, "cases": [measure(task, num_envs, steps, **case) for case in cases]}


def measure(task: str, num_envs: int, steps: int, **options: Any) -> dict[str, Any]:
    """Steps per second and compile time of one setting."""
    if options.get("impl") == "warp":
        options["worlds"] = num_envs
    env = setup.build(task, options)
    state = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), num_envs))

    def play(state, key):
        def move(state, key):
            action = jax.random.uniform(key, (num_envs, env.action_size), minval=-1.0)
            return jax.vmap(env.step)(state, action), None

        return jax.lax.scan(move, state, jax.random.split(key, steps))[0]

    program, compile_s = compile_timed(play, state, jax.random.key(0), plain=True)
    numbers = itertools.count()

    def call():
        nonlocal state
        state = program(state, jax.random.key(next(numbers)))
        return state

    speed = speeds({task: call}, {task: num_envs * steps}, _REPEATS)[task]
    return {
        "options": options,
        "num_envs": num_envs,
        "control_steps_per_s": round(speed),
        "compile_s": round(compile_s, 2),
        "finite": _finite(state),
    }


def _finite(states: Any) -> float:
    """Share of episodes."""
    leaves = [np.asarray(x) for x in jax.tree.leaves(states)]
    found = [np.isfinite(x).reshape(len(x), -1).all(1) for x in leaves if x.dtype == jnp.float32]
    return float(np.all(found, axis=0).mean())
