"""Measures of the rewards that a study's rows have learned, such as their audit.

A row's measure is kept as the phase `NAME-CELL`, so that a run that goes on does not repeat it.
"""

import functools
import itertools
from collections.abc import Callable, Hashable, Mapping, Sequence
from concurrent.futures import Executor, Future
from typing import Any, NamedTuple

import jax

from gril_jax.compilation import ahead
from gril_jax.compilation.compiler import compiled
from gril_jax.config import EnvConfig, RunConfig
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.runs.progress import Progress
from gril_jax.runs.run_dir import RunDir
from gril_jax.workflows.build import setup
from gril_jax.workflows.learning.encoders import stack

from ..rewards import TrainedReward, reward_key
from ..rows import Row, learns


@functools.cache
def num_classes(config: EnvConfig) -> int:
    """The number of classes that the boxes of a task have."""
    return len(setup.make_env(config, training=False).classes)


class Measure(NamedTuple):
    """Something measured of a row's rewards, which differ in their seeds alone."""

    name: str  # of its phases, before the row's number
    # From what `lower` gives, compiled, the row's configuration and its rewards, to the phase.
    measure: Callable[[Any, RunConfig, list[TrainedReward]], Mapping[str, Any]]
    same: Callable[[RunConfig], Hashable] | None = None  # equal for rows that share programs
    # The programs for rewards of boxes, from the shapes of their parameters.
    lower: Callable[[RunConfig, RewardParams], Sequence[jax.stages.Lowered]] | None = None
    asked: Callable[[RunConfig], bool] = lambda config: True  # False for rows to be left out

    def compile(self, config: RunConfig, count: int) -> list[jax.stages.Compiled]:
        """The programs for so many rewards."""
        with ahead.tracing():
            blank = [setup.blank_reward(config, num_classes(config.env))] * count
            lowered = self.lower(config, jax.eval_shape(lambda: stack(blank)))
        return [compiled(one) for one in lowered]


TAU = Measure("tau", lambda programs, config, found: {"tau": [one.tau for one in found]})


def tasks(
    measures: Sequence[Measure],
    rows: Sequence[Row],
    learned: Mapping[Hashable, TrainedReward],
    needs: Callable[[Sequence[Row]], frozenset[str]],
    run: RunDir,
    pool: Executor,
    progress: Progress,
    then: Callable[[], Any],
) -> list[ahead.Task]:
    """A task for each measure of each row that is not among the run's phases.

    Rows that learn no reward are not measured, and those of pictures not by a program.
    `learned` is filled while other tasks are carried out; `needs` names the tasks that learn some
    rows' rewards; `then` is called after each.
    """
    begun: dict[Hashable, Future[Any]] = {}
    found = []

    def do(name: str, one: Measure, members: list[Row], ready: Future[Any] | None) -> None:
        phase = progress.phase(f"measuring {name}", total=len(members), unit="rewards")
        rewards = [learned[reward_key(row.config)] for row in members]
        programs = None if ready is None else ready.result()
        run.finish_phase(name, one.measure(programs, members[0].config, rewards))
        phase.update(len(members))
        then()

    for one in measures:
        for cell, of_row in itertools.groupby(rows, lambda row: row.cell):
            members = [*of_row]
            name, config, ready = f"{one.name}-{cell}", members[0].config, None
            if not learns(config) or not one.asked(config):
                continue
            if run.finished_phase(name) is not None:
                continue
            if one.same is not None:
                if config.encoder.kind == "pixels":
                    continue
                key = (one.name, one.same(config), len(members))
                if key not in begun:
                    begun[key] = pool.submit(one.compile, config, len(members))
                ready = begun[key]
            work = functools.partial(do, name, one, members, ready)
            found.append(ahead.Task(name, ready, needs(members), work))
    return found


def stacked(found: Sequence[TrainedReward]) -> RewardParams:
    """Parameters of several rewards with a leading axis."""
    return stack([one.params for one in found])
