"""The rewards of a table's rows: encoders that compile to the same program train side by side."""

import functools
from collections.abc import Callable, Hashable, Iterable, Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import jax

from gril_jax import reward
from gril_jax.compilation import ahead
from gril_jax.config import RunConfig
from gril_jax.runs.memory import Run
from gril_jax.runs.progress import Progress
from gril_jax.types import DemoBatch
from gril_jax.workflows.build import demonstrations, learners
from gril_jax.workflows.learning import encoders

from .rows import Row, learns


class TrainedReward(NamedTuple):
    """A learned reward, its tau and its demonstrations."""

    params: reward.RewardParams
    tau: float
    demos: DemoBatch
    num_classes: int


def reward_key(config: RunConfig) -> Hashable:
    """The part of the configuration that a learned reward depends on."""
    parts = (config.demos, config.encoder, config.pool, config.loss, config.pretrain)
    return task_key(config), parts, config.run.seed


# What policies alone are given: neither demonstrations nor encoders depend on it.
_OF_POLICIES = {
    "reward", "observation", "variant", "varied_starts", "near_starts"
}  # fmt: skip


def task_key(config: RunConfig) -> Hashable:
    """The task that demonstrations and encoders depend on."""
    return tuple(value for name, value in vars(config.env).items() if name not in _OF_POLICIES)


class Wanted(NamedTuple):
    """Rewards that share one program, which is being compiled."""

    keys: list[Hashable]
    config: RunConfig  # of one of them
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
        same = (task_key(config), config.demos, static, config.pretrain.steps)
        groups.setdefault(same, []).append(key)
    found = []
    for members in groups.values():
        configs = [needed[key] for key in members]
        demos = gather(configs[0])
        found.append(Wanted(members, configs[0], demos, _compiled(configs, demos, pool)))
    return found


def tasks(
    wanted: Sequence[Wanted],
    found: dict[Hashable, TrainedReward],
    run: Run,
    progress: Progress,
    echo: Callable[[str], None],
) -> list[ahead.Task]:
    """One task per program, which adds its rewards to the found ones."""

    def learn(name: str, one: Wanted) -> None:
        found.update(_learned(name, one, run, progress, echo))

    def task(name: str, one: Wanted) -> ahead.Task:
        last = one.programs.reward  # the last to be compiled
        return ahead.Task(name, last, frozenset(), functools.partial(learn, name, one))

    return [task(_name(i), one) for i, one in enumerate(wanted)]


def needed(wanted: Sequence[Wanted], rows: Iterable[Row]) -> frozenset[str]:
    """Names of the tasks that learn these rows' rewards."""
    asked = {reward_key(row.config) for row in rows if learns(row.config)}
    return frozenset(_name(i) for i, one in enumerate(wanted) if not asked.isdisjoint(one.keys))


def _name(number: int) -> str:
    return f"reward-{number}"


def _learned(
    name: str, one: Wanted, run: Run, progress: Progress, echo: Callable[[str], None]
) -> dict[Hashable, TrainedReward]:
    """Trains the encoders of a program."""
    programs = one.programs
    state = encoders.train(
        programs, one.config, name=name, run=run, progress=progress, echo=echo,
        what=f"learning {len(one.keys)} rewards",
        row=lambda metrics: {"loss": metrics.loss.mean(axis=-1)},
    )  # fmt: skip
    trained = state, programs.data, programs.hyper
    params = jax.device_get(programs.reward.result()(*trained))
    tau = jax.device_get(programs.measure.result()(*trained))["tau"]
    train, num_classes = one.demos.batch("train"), len(one.demos.demo_set.classes)
    return {
        key: TrainedReward(
            jax.tree.map(lambda x, i=i: x[i], params), float(tau[i]), train, num_classes
        )
        for i, key in enumerate(one.keys)
    }


def _compiled(configs: Sequence[RunConfig], demos, pool: Executor) -> encoders.Programs:
    return encoders.compiled_for(configs, learners.learner(configs[0], demos), pool)
