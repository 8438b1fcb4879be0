"""Our PPO beside brax's own trainer on one pendulum, with the same hyper-parameters.

    gril bench brax                     five minutes on 2 CPU cores

Short runs, each in a process of its own without a persistent cache: seconds from its start to its
end, and programs that XLA compiles. Then long runs, in which our chunks and brax's epochs take
turns: steps a second (of the fastest part, evaluations excluded) and final returns.
"""

import statistics
import time
from typing import Any

import jax
import numpy as np

from . import ours, stock
from .frame import in_new_process, rounded
from .pendulum import Setting

_SHORT, _LONG = Setting(), Setting(num_timesteps=400_000, num_evals=11)
_REPEATS = 3  # short runs of each, of which the fastest counts
_SIDES = ("ours", "stock")


def main(*, seeds: int) -> dict[str, Any]:
    """The figures of both, with so many long runs of each."""
    fresh = fresh_processes(_SHORT, _REPEATS)  # before this process takes a GPU's memory
    return {"setting": vars(_SHORT), "fresh_process": fresh, "long_runs": long_runs(_LONG, seeds)}


def fresh_processes(setting: Setting, repeats: int) -> dict[str, Any]:
    """Seconds and compilations of a run from the start of its process to the end."""
    seconds = dict.fromkeys(_SIDES, float("inf"))
    answers = {}
    for _ in range(repeats):
        for side in _SIDES:
            start = time.perf_counter()
            answers[side] = in_new_process(
                f"from gril_jax.experiments.bench import {side}, pendulum",
                f"{side}.train(0, pendulum.{setting!r})",
                f"the run of {side}", JAX_ENABLE_COMPILATION_CACHE="0",
            )  # fmt: skip
            seconds[side] = min(seconds[side], time.perf_counter() - start)
    made = {side: answer.made for side, answer in answers.items()}
    return {
        "steps": setting.parts * setting.steps,
        "evaluations": setting.num_evals,
        "seconds": rounded(seconds),
        "compile_s": rounded({side: answer.compile_s for side, answer in answers.items()}),
        "compilations": made,
        "times_as_fast": round(seconds["stock"] / seconds["ours"], 2),
        "share_of_compilations": round(made["ours"] / made["stock"], 3),
    }


def long_runs(setting: Setting, seeds: int) -> dict[str, Any]:
    """Steps per second of the fastest part of each side, and the last returns of each seed."""
    init, run = ours.chunks(setting)
    updates, none, yes, no = np.int32(setting.updates), np.int32(0), np.bool_(True), np.bool_(0)
    speeds: dict[str, list[float]] = {side: [] for side in _SIDES}
    returns: dict[str, list[float]] = {side: [] for side in _SIDES}
    run(init(0), none, no)  # compiles
    for seed in range(seeds):
        state, last = init(seed), 0.0

        def in_turn(done, _, speed):
            nonlocal state, last
            if not done:
                return
            start = time.perf_counter()
            state = jax.block_until_ready(run(state, updates, no)[0])
            speeds["ours"].append(setting.steps / (time.perf_counter() - start))
            speeds["stock"].append(speed)
            state, _, scores = run(state, none, yes)
            last = float(scores.reward[0, 1])

        returns["stock"].append(stock.train(seed, setting, in_turn)[-1])
        returns["ours"].append(last)
    middle = {side: statistics.median(found) for side, found in speeds.items()}
    top = {side: max(found) for side, found in speeds.items()}
    return {
        "steps": setting.parts * setting.steps,
        "steps_per_s": rounded(top, 0),
        "median_steps_per_s": rounded(middle, 0),
        "share_of_stock": round(top["ours"] / top["stock"], 3),
        "median_share_of_stock": round(middle["ours"] / middle["stock"], 3),
        "returns": {side: [round(x, 1) for x in found] for side, found in returns.items()},
        "mean_return": rounded({side: statistics.mean(x) for side, x in returns.items()}),
    }
