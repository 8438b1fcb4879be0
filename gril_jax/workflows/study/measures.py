"""Measures of the rewards that a study's rows have learned, such as their audit.

A row's measure is kept as the phase `NAME-CELL`, so that a run that goes on does not repeat it. A
line has its lists of numbers, with one number for each reward. Shapes use S for rewards.
"""

import functools
import itertools
from collections.abc import Callable, Hashable, Mapping, Sequence
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import jax
import numpy as np

from gril_jax import reward
from gril_jax.compilation import ahead, compiler
from gril_jax.config import EnvConfig, RunConfig
from gril_jax.config.grid import with_seed
from gril_jax.metrics.order import two_way_cycle_consistency
from gril_jax.pretraining import pretrain
from gril_jax.runs.progress import Progress
from gril_jax.runs.run_dir import RunDir
from gril_jax.types import DemoBatch
from gril_jax.workflows import export_reward
from gril_jax.workflows.build import setup, vocabulary
from gril_jax.workflows.build.demonstrations import Demonstrations
from gril_jax.workflows.learning import diverged
from gril_jax.workflows.learning.encoders import stack

from .rewards import TrainedReward, reward_key, set_key
from .saved import Plan, Row, learns, root, row_files

Gather = Callable[[RunConfig], Demonstrations]


@functools.cache
def num_classes(config: EnvConfig) -> int:
    """The number of classes that the boxes of a task have."""
    return len(setup.make_env(config, training=False).classes)


class Measure:
    """Something measured of a row's rewards, which differ in their seeds alone."""

    name = ""  # of its phases, before the row's number
    words = ""  # what is done, as it is shown
    compiled = False  # True if it has programs, which are for rewards of boxes alone

    def asked(self, config: RunConfig) -> bool:
        """False for rows to be left out."""
        return True

    def same(self, config: RunConfig) -> Hashable:
        """Equal for rows that share programs."""
        raise NotImplementedError

    def lower(self, config: RunConfig, params: reward.RewardParams) -> Sequence[jax.stages.Lowered]:
        """The programs, from the shapes of the rewards' parameters."""
        raise NotImplementedError

    def measure(
        self, programs: Any, config: RunConfig, found: Sequence[TrainedReward]
    ) -> Mapping[str, Any]:
        """The phase, from what `lower` gives, compiled, and a row's rewards."""
        raise NotImplementedError

    def compile(self, config: RunConfig, count: int) -> list[jax.stages.Compiled]:
        """The programs for so many rewards."""
        with ahead.tracing():
            blank = [setup.blank_reward(config, num_classes(config.env))] * count
            lowered = self.lower(config, jax.eval_shape(lambda: stack(blank)))
        return [compiler.compiled(one) for one in lowered]


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
        words = f"row {members[0].cell + 1}: {one.words}"
        phase = progress.phase(words, total=len(members), unit="rewards")
        rewards = [learned[reward_key(row.config)] for row in members]
        lost = {i: one.diverged for i, one in enumerate(rewards) if one.diverged}
        diverged.require_some(lost, len(rewards))
        programs = None if ready is None else ready.result()
        run.finish_phase(name, _kept(one.measure(programs, members[0].config, rewards), rewards))
        phase.update(len(members))
        then()

    for one, (cell, of_row) in itertools.product(
        measures, [(k, [*rows]) for k, rows in itertools.groupby(rows, lambda row: row.cell)]
    ):
        name, config, ready = f"{one.name}-{cell}", of_row[0].config, None
        if not learns(config) or not one.asked(config) or run.finished_phase(name) is not None:
            continue
        if one.compiled:
            if config.encoder.kind == "pixels":
                continue
            key = (one.name, one.same(config), len(of_row))
            ready = begun[key] = begun.get(key) or pool.submit(one.compile, config, len(of_row))
        work = functools.partial(do, name, one, of_row, ready)
        found.append(ahead.Task(name, ready, needs(of_row), work, of_row))
    return found


def _kept(found: Mapping[str, Any], rewards: Sequence[TrainedReward]) -> dict[str, Any]:
    """The measured values, with None for rewards that diverged."""

    def known(values: Any) -> Any:
        numbers = isinstance(values, list) and all(isinstance(x, float | int) for x in values)
        if not numbers or len(values) != len(rewards):
            return values
        pairs = zip(values, rewards, strict=True)
        return [None if of.diverged else value for value, of in pairs]

    return {name: known(values) for name, values in found.items()}


# --- what needs neither stages nor failures


class Tau(Measure):
    """The alignment tau on demonstrations kept aside, which each reward has from its training."""

    name, words = "tau", "tau of held-out videos"

    def measure(self, programs, config, found):
        """The taus as they are."""
        return {"tau": [one.tau for one in found]}


class Profiles(Measure):
    """Order of demonstrations kept aside, and rewards along them and along failures."""

    name, words, compiled = "profiles", "rewards along videos", True

    def __init__(self, gather: Gather) -> None:
        self.gather = gather

    def same(self, config):
        """The task, its demonstrations and the encoder's form."""
        static = setup.embedding_config(config, num_classes(config.env))
        return set_key(config), static

    def lower(self, config, params):
        """A program for demonstrations kept aside, and one for failures if there are any."""
        static, hyper = self.same(config)[-1], setup.pretrain_hyper(config)
        return [_profiles(static).lower(params, hyper, batch) for batch in self._batches(config)]

    def measure(self, programs, config, found):
        """Numbers of each encoder: two-way cycle consistency, tau of reward and time, last reward.

        `success` and `failure` are the first reward along each demonstration, three decimals."""
        params, hyper = stack([one.params for one in found]), setup.pretrain_hyper(config)
        numbers: list[dict[str, Any]] = []
        traces: list[list[list[float]]] = []
        for run, batch in zip(programs, self._batches(config), strict=True):
            each, rewards = run(params, hyper, batch)
            numbers.append({name: values.tolist() for name, values in each.items()})
            first = np.asarray(rewards[0], float).round(3)
            traces.append([x[:n].tolist() for x, n in zip(first, batch.length, strict=True)])
        return numbers[0] | {"success": traces[0], "failure": traces[1] if traces[1:] else []}

    def _batches(self, config: RunConfig) -> list[DemoBatch]:
        demos = self.gather(config)
        splits = ["validation", *(["failure"] if demos.names["failure"] else [])]
        return [demos.batch(split) for split in splits]


def _profiles(static: pretrain.Static):
    """Jitted program: (S rewards, hyper, demonstrations) -> numbers, rewards along them."""

    @jax.jit
    def run(params: reward.RewardParams, hyper: pretrain.Hyper, batch: DemoBatch):
        def one(params):
            latents = pretrain.embed(params.encoder, batch, hyper, static)
            figures = pretrain.figures(params, latents, batch.length)
            numbers = {name: figures[name] for name in ("reward_time_tau", "reward_last")}
            numbers |= {"cycle": two_way_cycle_consistency(latents, batch.length)}
            return numbers, reward.latent_reward(params, latents)

        return jax.vmap(one)(params)

    return run


class Files(Measure):
    """Each reward as a file with its goals, `rewards/ROW-SEED.npz` in the study's folder."""

    name, words = "files", "writing the rewards"

    def __init__(self, plan: Plan, run: Path) -> None:
        self.plan, self.run = plan, run

    def measure(self, programs, config, found):
        """Writes the rewards of a row, named after the first row of the work that learns them."""
        files, plan = row_files(self.run, [*self.plan.rows]), self.plan
        key = reward_key(with_seed(config, plan.config.run.seed - config.run.seed))
        made = {name: x for name, x in plan.rows.items() if name in plan.work and learns(x)}
        stem = next(files[name].stem for name, x in made.items() if reward_key(x) == key)
        env = setup.make_env(config.env, training=False)
        words = vocabulary.of_task(env, config.env.name)
        out = root(self.run) / "rewards"
        out.mkdir(parents=True, exist_ok=True)
        sound = {i: one for i, one in enumerate(found) if not one.diverged}
        names = {i: f"{stem}-{config.run.seed + i}" for i in sound}
        for i, one in sound.items():
            known = {"kendall_tau": one.tau}
            learned = export_reward.described(with_seed(config, i), one.params, words, known)
            learned.save(out / f"{names[i]}.npz", overwrite=True)
        return {"files": [*names.values()]}
