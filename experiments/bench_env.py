"""Control steps per second of MatchRegions, random actions in parallel episodes, as JSON.

    gril bench env                      the default setting
    gril bench env --levers True        what each setting of the solver gives, and the MJX engine

Throughput is the best of `repeats` runs of a compiled scan; compile time is that of the scan. On 2
CPU cores a case takes about 15 s, on one H200 about 20 s.
"""

import contextlib
import io
import json
import time
from collections.abc import Callable

import jax

from gril_jax import envs

from . import setup

__all__ = ["main", "measure"]

# Settings of the solver, from the original's own to the coarsest, and the other engine.
_LEVERS = [
    {"substeps": 10, "iterations": 10},
    {"substeps": 10, "iterations": 6},
    {"substeps": 10, "iterations": 4},
    {"substeps": 7, "iterations": 4},
    {"substeps": 5, "iterations": 5},
    {"engine": "mjx", "substeps": 10, "iterations": 4},
    {"engine": "mjx", "substeps": 5, "iterations": 2},
    {"variant": "all"},
    {"robot": "short"},
    {"targets": ("green square",), "distractors": ("yellow circle",)},
]


def measure(lanes: int, steps: int, repeats: int, **options) -> dict:
    """Steps per second and compile time of one setting."""
    with contextlib.redirect_stdout(io.StringIO()):  # mjx reports on optional parts
        env = envs.make("match_regions", **options)
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
    }


def main(
    lanes: int | None, steps: int, repeats: int, *, levers: bool, echo: Callable[[str], None]
) -> None:
    """Echo the figures as JSON."""
    lanes = lanes or (256 if jax.default_backend() == "cpu" else 32_768)
    cases = _LEVERS if levers else [{}]
    figures = [measure(lanes, steps, repeats, **case) for case in cases]
    result = {"device": setup.device_in_words(), "jax": jax.__version__, "cases": figures}
    echo(json.dumps(result, indent=2))
