"""Control steps per second of a task, random actions in parallel episodes.

    gril bench env                      MatchRegions
    gril bench env --task shoes_in_box

Throughput is the best of some runs of a compiled scan, and `finite` the share of episodes whose
numbers all are. MatchRegions takes about 15 s on 2 CPU cores, the shoes longer.
"""

import itertools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gril_jax import envs
from gril_jax.workflows.build import setup

from .frame import compile_timed, speeds

_REPEATS = 5


def main(*, task: str, num_envs: int | None, steps: int) -> dict[str, Any]:
    """The figures of a task with its default options."""
    num_envs = num_envs or (256 if jax.default_backend() == "cpu" else envs.spec(task).bench_envs)
    env = setup.build(task, {})
    numbers = itertools.count()

    def play(state, key):
        def move(state, key):
            action = jax.random.uniform(key, (num_envs, env.action_size), minval=-1.0)
            return jax.vmap(env.step)(state, action), None

        return jax.lax.scan(move, state, jax.random.split(key, steps))[0]

    state = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), num_envs))
    program, compile_s = compile_timed(play, state, jax.random.key(0), plain=True)

    def call():
        nonlocal state
        state = program(state, jax.random.key(next(numbers)))
        return state

    speed = speeds({task: call}, {task: num_envs * steps}, _REPEATS)[task]
    return {
        "task": task,
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
