"""Measures of the rewards that a table's rows have learned; each is a phase of the run.

    measures.tasks([audit, ...], names, rows, learned, needs, run, pool, progress, written)

A row's measure is kept as the phase `NAME-CELL`, so that a run that goes on does not repeat it.
"""

from collections.abc import Callable, Hashable, Mapping, Sequence
from concurrent.futures import Executor, Future
from typing import Any, NamedTuple

import jax
from gril_jax.experiments.pipeline import setup

from gril_jax import reward
from gril_jax.compilation import ahead
from gril_jax.config import RunConfig
from gril_jax.runs.progress import Progress
from gril_jax.runs.run_dir import RunDir

from .rewards import LearnedReward, learns, reward_key, stack
from .rows import Row


class Measure(NamedTuple):
    """Something measured of a row's rewards, which differ in their seeds alone."""

    name: str  # of its phases, before the row's number
    measure: Callable[[Any, RunConfig, list[LearnedReward]], Mapping[str, Any]]  # the phase
    same: Callable[[RunConfig], Hashable] | None = None  # equal for rows that share a program
    compile: Callable[[RunConfig, int], Any] | None = None  # for rewards of boxes, so many


TAU = Measure("tau", lambda program, config, found: {"tau": [one.tau for one in found]})


def tasks(
    measures: Sequence[Measure],
    rows: Sequence[Row],
    learned: Mapping[Hashable, LearnedReward],
    needs: Callable[[Sequence[Row]], frozenset[str]],
    run: RunDir,
    pool: Executor,
    progress: Progress,
    then: Callable[[], Any],
) -> list[ahead.Task]:
    """A task for each measure of each row that is not among the run's phases.

    Rows that learn no reward are not measured, and those of pictures not by a program.
    `learned` is filled, by `reward_key`, while other tasks are carried out; `needs` names the
    tasks that learn some rows' rewards; `then` is called after each.
    """
    begun: dict[Hashable, Future[Any]] = {}
    found = []
    of: dict[int, list[Row]] = {}
    for row in rows:
        if learns(row.config):
            of.setdefault(row.cell, []).append(row)
    for one in measures:
        for cell, members in of.items():
            name, config, ready = f"{one.name}-{cell}", members[0].config, None
            if run.finished_phase(name) is not None:
                continue
            if one.compile is not None and one.same is not None:
                if config.encoder.kind == "pixels":
                    continue
                key = (one.name, one.same(config), len(members))
                if key not in begun:
                    begun[key] = pool.submit(one.compile, config, len(members))
                ready = begun[key]

            def do(name=name, one=one, members=members, ready=ready) -> None:
                phase = progress.phase(f"measuring {name}", total=len(members), unit="rewards")
                rewards = [learned[reward_key(row.config)] for row in members]
                program = None if ready is None else ready.result()
                run.finish_phase(name, one.measure(program, members[0].config, rewards))
                phase.update(len(members))
                then()

            found.append(ahead.Task(name, ready, needs(members), do))
    return found


def stacked(found: Sequence[LearnedReward]) -> reward.RewardParams:
    """Parameters of several rewards with a leading axis."""
    return stack([one.params for one in found])


def blank_rewards(config: RunConfig, num_classes: int, count: int) -> reward.RewardParams:
    """Shapes of `stacked`, to compile for."""
    blank = setup.blank_reward(config, num_classes)
    return jax.eval_shape(lambda: stack([blank] * count))
