"""PPO and SAC on tasks with published returns, beside brax's own trainers.

    gril bench known                    about 20 minutes on 2 CPU cores

Both sides have the same hyper-parameters, and returns are those of mean actions at the end. What
brax's SAC has fixed is fixed for ours too. Tasks, algorithms and sides have processes of their own,
some at a time, because compiling takes most of the time.
"""

import statistics
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

from gril_jax import threads

from . import ours, stock
from .frame import in_new_process, rounded
from .gymnasium_tasks import InvertedPendulum, Reacher
from .pendulum import Pendulum, SacSetting, Setting


class Published(NamedTuple):
    """A published return to compare with."""

    mean: float
    spread: float  # one standard deviation, over episodes or over runs: see `source`
    source: str


class Ground(NamedTuple):
    """One task with its settings for training."""

    task: type[Any]
    settings: dict[str, Setting | SacSetting]  # of each algorithm
    published: dict[str, Published]


_ZOO = "RL Baselines3 Zoo, benchmark.md: one run, spread over 750 episodes; steps {}"
_TIANSHOU = "Tianshou, examples/mujoco: best of 1M steps, mean and spread over 10 runs"

GROUND = {
    "pendulum": Ground(
        Pendulum,
        {"ppo": Setting(num_timesteps=204_800, num_epochs=8), "sac": SacSetting()},
        {"ppo": Published(-172.2, 104.2, _ZOO.format("100k")),
         "sac": Published(-157.0, 88.7, _ZOO.format("20k"))},
    ),
    "inverted_pendulum": Ground(
        InvertedPendulum,
        {"ppo": Setting(num_timesteps=307_200, learning_rate=5e-4, discounting=0.99),
         "sac": SacSetting(num_timesteps=40_960, discounting=0.99, reward_scaling=0.1)},
        {name: Published(1000.0, 0.0, _TIANSHOU) for name in ("ppo", "sac")},
    ),
    "reacher": Ground(
        Reacher,
        {"ppo": Setting(num_timesteps=512_000, unroll_length=10, num_minibatches=16,
                        num_epochs=8, entropy_cost=0.0, reward_scaling=1.0),
         "sac": SacSetting(num_timesteps=40_960, discounting=0.95, reward_scaling=10.0)},
        {"ppo": Published(-4.1, 0.3, _TIANSHOU), "sac": Published(-2.6, 0.2, _TIANSHOU)},
    ),
}  # fmt: skip

EPISODES = 256  # of mean actions: starts differ, and the mean over a few does, too
SIDES = {"ours": ours.all_returns, "stock": stock.all_returns}


def main(
    *, tasks: Sequence[str], algorithms: Sequence[str], seeds: int, jobs: int | None
) -> dict[str, Any]:
    """The figures of both sides."""
    start = time.perf_counter()
    pairs = [(task, algorithm) for task in tasks for algorithm in algorithms]
    # Those that take longest come first.
    wanted = [(*pair, side, seeds) for side in reversed(SIDES) for pair in reversed(pairs)]
    with ThreadPoolExecutor(jobs or max(1, threads.cores() // 2)) as pool:
        found = dict(zip(wanted, pool.map(_child, wanted), strict=True))
    rows = [compared(*pair, {side: found[*pair, side, seeds] for side in SIDES}) for pair in pairs]
    return {"seeds": seeds, "seconds": round(time.perf_counter() - start, 1), "rows": rows}


def measure(
    task: str, algorithm: str, side: str, seeds: int, setting: Setting | SacSetting | None = None
) -> dict[str, Any]:
    """One side's returns at the last and the first evaluation, for each seed, and its seconds."""
    ground = GROUND[task]
    start = time.perf_counter()
    returns = SIDES[side](setting or ground.settings[algorithm], ground.task(), seeds, EPISODES)
    return {
        "returns": [round(each[-1], 2) for each in returns],
        "untrained": [round(each[0], 2) for each in returns],
        "seconds": round(time.perf_counter() - start, 1),
    }


def compared(task: str, algorithm: str, found: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Both sides of one task and algorithm beside the published return."""
    published = GROUND[task].published[algorithm]
    means = {side: statistics.mean(what["returns"]) for side, what in found.items()}
    return {
        "task": task,
        "algorithm": algorithm,
        "steps": GROUND[task].settings[algorithm].num_timesteps,
        **found,
        "published": published._asdict(),
        "mean_return": rounded(means),
        "above_published": rounded({side: mean - published.mean for side, mean in means.items()}),
    }


def _child(wanted: tuple[str, str, str, int]) -> dict[str, Any]:
    task, algorithm, side, _ = wanted
    found, whose = f"from {__package__} import known", f"{algorithm} of {side} on {task}"
    return in_new_process(found, f"known.measure{wanted!r}", whose).value
