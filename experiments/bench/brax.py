"""Our PPO beside brax's own trainer on one pendulum, with the same hyper-parameters, as JSON.

    gril bench brax                     five minutes on 2 CPU cores

Short runs, each in a process of its own without a persistent cache: seconds from the start of the
process to its end, and programs that XLA compiles. Then long runs, in which our chunks and brax's
epochs take turns: steps a second (of the fastest part, evaluations excluded) and final returns.
"""

import dataclasses
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from gril_jax.experiments.pipeline import setup

from gril_jax.errors import RunError

from . import ours, stock
from .pendulum import Setting

__all__ = ["fresh_processes", "long_runs", "main"]

_CHILD = """
import json, sys
from gril_jax.experiments import bench_{side} as side
from gril_jax.experiments.bench_clock import counted
from gril_jax.experiments.bench_pendulum import Setting

given = json.loads(sys.argv[1])
setting = Setting(**given | {{"hidden": tuple(given["hidden"])}})
with counted() as count:
    returns = side.train(0, setting)
answer = {{"returns": returns, "compilations": count.made, "compile_s": count.seconds}}
print(json.dumps(answer))
"""


def main(*, repeats: int, seeds: int, num_timesteps: int, echo: Callable[[str], None]) -> None:
    """Echo the figures of both as JSON.

    Args:
      repeats: short runs of each, of which the fastest counts.
      seeds: long runs of each.
      num_timesteps: of a long run.
      echo: takes the JSON.
    """
    short = Setting()
    long = Setting(num_timesteps=num_timesteps, num_evals=11)
    fresh = fresh_processes(short, repeats)  # before this process takes a GPU's memory
    result = {
        "device": setup.device_in_words(), "jax": jax.__version__, "setting": vars(short),
        "fresh_process": fresh, "long_runs": long_runs(long, seeds),
    }  # fmt: skip
    echo(json.dumps(result, indent=2))


def fresh_processes(setting: Setting, repeats: int) -> dict[str, Any]:
    """Seconds and compilations of a run from the start of its process to the end."""
    seconds: dict[str, float] = {"ours": float("inf"), "stock": float("inf")}
    processor_s = dict(seconds)  # other loads lengthen it less
    answers: dict[str, Any] = {}
    for _ in range(repeats):
        for side in seconds:
            start, spent = time.perf_counter(), os.times()
            answers[side] = _child(side, setting)
            seconds[side] = min(seconds[side], time.perf_counter() - start)
            now = os.times()
            spent_s = sum(now[2:4]) - sum(spent[2:4])  # of children, user and system
            processor_s[side] = min(processor_s[side], spent_s)
    made = {side: answers[side]["compilations"] for side in seconds}
    return {
        "steps": setting.parts * setting.updates * setting.num_envs * setting.unroll_length,
        "evaluations": setting.num_evals,
        "seconds": _rounded(seconds),
        "processor_s": _rounded(processor_s),
        "compile_s": _rounded({side: answers[side]["compile_s"] for side in seconds}),
        "compilations": made,
        "times_as_fast": round(seconds["stock"] / seconds["ours"], 2),
        "share_of_compilations": round(made["ours"] / made["stock"], 3),
    }


def long_runs(setting: Setting, seeds: int) -> dict[str, Any]:
    """Steps a second of the fastest part of each, and the last returns of each seed."""
    init, run = ours.chunks(setting)
    steps = setting.updates * setting.num_envs * setting.unroll_length
    updates, none, yes, no = np.int32(setting.updates), np.int32(0), np.bool_(True), np.bool_(0)
    speeds: dict[str, list[float]] = {"ours": [], "stock": []}
    returns: dict[str, list[float]] = {"ours": [], "stock": []}
    run(init(0), none, no)  # compiles
    for seed in range(seeds):
        state, last = init(seed), 0.0

        def in_turn(done, _, speed):
            nonlocal state, last
            if not done:
                return
            start = time.perf_counter()
            state = jax.block_until_ready(run(state, updates, no)[0])
            speeds["ours"].append(steps / (time.perf_counter() - start))
            speeds["stock"].append(speed)
            state, _, scores = run(state, none, yes)
            last = float(scores.reward[0, 1])

        returns["stock"].append(stock.train(seed, setting, in_turn)[-1])
        returns["ours"].append(last)
    middle = {side: statistics.median(found) for side, found in speeds.items()}
    best = {side: max(found) for side, found in speeds.items()}
    return {
        "steps": setting.parts * steps,
        "steps_per_s": _rounded(best, 0),
        "median_steps_per_s": _rounded(middle, 0),
        "share_of_stock": round(best["ours"] / best["stock"], 3),
        "median_share_of_stock": round(middle["ours"] / middle["stock"], 3),
        "returns": {side: [round(x, 1) for x in found] for side, found in returns.items()},
        "mean_return": _rounded({side: statistics.mean(x) for side, x in returns.items()}),
    }


def _child(side: str, setting: Setting) -> dict[str, Any]:
    """What a run in a process of its own says of itself."""
    surroundings = {
        **os.environ, "JAX_ENABLE_COMPILATION_CACHE": "0", "XLA_PYTHON_CLIENT_PREALLOCATE": "false"
    }  # fmt: skip
    given = json.dumps(dataclasses.asdict(setting))
    command = [sys.executable, "-c", _CHILD.format(side=side), given]
    done = subprocess.run(command, capture_output=True, text=True, env=surroundings, check=False)
    if done.returncode:
        raise RunError(f"the run of {side} failed: {done.stderr.strip().splitlines()[-1]}")
    return json.loads(done.stdout.splitlines()[-1])


def _rounded(values: dict[str, float], digits: int = 2) -> dict[str, float]:
    return {name: round(value, digits) for name, value in values.items()}
