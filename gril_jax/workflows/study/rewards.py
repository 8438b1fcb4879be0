"""The rewards of a study's rows: encoders that compile to the same program train side by side."""

from collections.abc import Callable, Hashable, Iterable, Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import jax

from gril_jax import reward
from gril_jax.config import RunConfig
from gril_jax.runs.memory import Run
from gril_jax.runs.progress import Progress
from gril_jax.types import DemoBatch
from gril_jax.workflows.build import demonstrations, learners
from gril_jax.workflows.learning import encoders

from .saved import Row, learns


class TrainedReward(NamedTuple):
    """A learned reward, its tau and its demonstrations.

    One that diverged has the numbers of another one, which are not to be used."""

    params: reward.RewardParams
    tau: float | None
    demos: DemoBatch
    num_classes: int
    diverged: str | None = None  # a sentence if it did


def reward_key(config: RunConfig) -> Hashable:
    """The part of the configuration that a learned reward depends on."""
    parts = (config.demos, config.encoder, config.pool, config.loss, config.pretrain)
    return task_key(config), parts, config.run.seed


# What policies alone are given: neither demonstrations nor encoders depend on it.
_OF_POLICIES = {"reward", "observation", "variant", "varied_starts", "near_starts"}


def task_key(config: RunConfig) -> Hashable:
    """The task that demonstrations and encoders depend on."""
    return tuple(value for name, value in vars(config.env).items() if name not in _OF_POLICIES)


def set_key(config: RunConfig) -> Hashable:
    """The demonstrations that encoders learn from and are measured on."""
    return task_key(config), config.demos


class Wanted(NamedTuple):
    """Rewards that share one program, which is being compiled."""

    name: str  # of their phase, and of the task that learns them
    keys: list[Hashable]
    configs: list[RunConfig]  # of each
    rows: list[Row]  # that have them
    demos: demonstrations.Demonstrations
    programs: encoders.Programs


def get_ready(
    rows: Sequence[Row],
    gather: Callable[[RunConfig], demonstrations.Demonstrations],
    pool: Executor,
) -> list[Wanted]:
    """Starts to compile, in a pool, the training of every reward that a row needs."""
    needed = {reward_key(row.config): row.config for row in rows if learns(row.config)}
    groups: dict[Hashable, list[Hashable]] = {}
    for key, config in needed.items():
        static = learners.static_config(config, len(gather(config).demo_set.classes))
        same = (set_key(config), static, config.pretrain.steps)
        groups.setdefault(same, []).append(key)
    found = []
    for number, members in enumerate(groups.values()):
        configs = [needed[key] for key in members]
        demos = gather(configs[0])
        programs = encoders.compiled_for(configs, learners.learner(configs[0], demos), pool)
        of = [row for row in rows if reward_key(row.config) in members]
        found.append(Wanted(f"reward-{number}", members, configs, of, demos, programs))
    return found


def needed(wanted: Sequence[Wanted], rows: Iterable[Row]) -> frozenset[str]:
    """Names of the tasks that learn these rows' rewards."""
    asked = {reward_key(row.config) for row in rows if learns(row.config)}
    return frozenset(one.name for one in wanted if not asked.isdisjoint(one.keys))


def learn(
    one: Wanted, run: Run, progress: Progress, echo: Callable[[str], None]
) -> dict[Hashable, TrainedReward]:
    """Trains the encoders of a program; the rewards by their keys."""
    trained = encoders.train(
        one.programs, one.configs, name=one.name, run=run, progress=progress, echo=echo,
        what=f"learning {len(one.keys)} rewards",
        row=lambda metrics: {"loss": metrics.loss.mean(axis=-1)},
    )  # fmt: skip
    params, tau = jax.device_get((trained.rewards, trained.measures.get("tau")))
    train, num_classes = one.demos.batch("train"), len(one.demos.demo_set.classes)
    lost, count = trained.diverged, len(one.keys)
    first = next(i for i in range(count) if i not in lost)
    found = {}
    for i, key in enumerate(one.keys):
        at = first if i in lost else i
        of = jax.tree.map(lambda x, at=at: x[at], params)
        found[key] = TrainedReward(
            of, None if tau is None else float(tau[at]), train, num_classes, lost.get(i)
        )
    return found
