"""Measures of the rewards that a table's rows have learned, such as their audit.

A row's measure is kept as the phase `NAME-CELL`, so that a run that goes on does not repeat it.
"""

import functools
import itertools
from collections.abc import Callable, Hashable, Mapping, Sequence
from concurrent.futures import Executor, Future
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gril_jax import envs
from gril_jax.audit import measures as audit_measures
from gril_jax.audit.measures import States, make_states
from gril_jax.audit.scene_reward import Scene, StagedTask, scene_reward
from gril_jax.compilation import ahead
from gril_jax.compilation.compiler import compiled
from gril_jax.config import EnvConfig, RunConfig
from gril_jax.encoders.encoder import GraphConfig
from gril_jax.errors import ConfigError
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.runs.memory import Run
from gril_jax.runs.progress import Progress
from gril_jax.workflows.build import setup
from gril_jax.workflows.learning.encoders import stack

from .rewards import TrainedReward, learns, reward_key
from .rows import Row


class Measure(NamedTuple):
    """Something measured of a row's rewards, which differ in their seeds alone."""

    name: str  # of its phases, before the row's number
    # From what `lower` gives, compiled, the row's configuration and its rewards, to the phase.
    measure: Callable[[Any, RunConfig, list[TrainedReward]], Mapping[str, Any]]
    same: Callable[[RunConfig], Hashable] | None = None  # equal for rows that share programs
    # The programs for rewards of boxes, from the shapes of their parameters.
    lower: Callable[[RunConfig, RewardParams], Sequence[jax.stages.Lowered]] | None = None
    num_classes: int = 0  # 0: those of the row's own task

    def compile(self, config: RunConfig, count: int) -> list[jax.stages.Compiled]:
        """The programs for so many rewards."""
        with ahead.tracing():
            known = self.num_classes or len(setup.make_env(config.env, training=False).classes)
            blank = [setup.blank_reward(config, known)] * count
            lowered = self.lower(config, jax.eval_shape(lambda: stack(blank)))
        return [compiled(one) for one in lowered]


TAU = Measure("tau", lambda programs, config, found: {"tau": [one.tau for one in found]})


def tasks(
    measures: Sequence[Measure],
    rows: Sequence[Row],
    learned: Mapping[Hashable, TrainedReward],
    needs: Callable[[Sequence[Row]], frozenset[str]],
    run: Run,
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
            if not learns(config) or run.finished_phase(name) is not None:
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


# Demo starts are the scene that policies are evaluated in; Layout starts have everything anywhere.
VARIANTS = ("demo", "layout")

# Short names of what is kept of `gril_jax.audit.measures.Measures`.
FIGURES = {
    "order": "order_accuracy",
    "touch": "touch_share",
    "push": "push_share",
    "hack_gap": "hack_gap",
    "hack_share": "hack_share",
    "hack_gap_anywhere": "hack_gap_anywhere",
    "outbid": "outbid_share",
}


class Ground(NamedTuple):
    """The states that rewards are audited on; the same for all."""

    task: StagedTask
    states: Mapping[str, States]  # by variant


def audit(variants: Mapping[str, envs.Env], *, starts: int, ascents: int) -> Measure:
    """The audit, from so many starts of each variant of a task, which share the ascents."""
    num_classes = len(next(iter(variants.values())).classes)

    made = functools.cache(functools.partial(ground, variants, starts=starts))

    def same(config: RunConfig):
        return setup.encoder_config(config, num_classes)

    def lower(config: RunConfig, params: RewardParams):
        run = audit_program(same(config), made().task, ascents=ascents)
        return [run.lower(params, next(iter(made().states.values())))]

    def figures(programs, config, found):
        values = audit_figures(*programs, stacked(found), made())
        return {name: x.tolist() for name, x in values.items()}

    return Measure("audit", figures, same, lower, num_classes)


def audited_tasks(config: EnvConfig, variants: Sequence[str] = VARIANTS) -> dict[str, envs.Env]:
    """The task in each variant; ConfigError if it lacks one of them, or a stage definition."""
    found = {v: setup.make_env(config, training=False, variant=v) for v in variants}
    if any(getattr(env, "stages", None) is None for env in found.values()):
        raise ConfigError(f"env.name is {config.name!r}, but must be a task with stages")
    return found


def ground(variants: Mapping[str, envs.Env], *, starts: int) -> Ground:
    """Synthetic states around some starts of each variant, which come from `audited_tasks`."""
    found = {}
    for number, (variant, env) in enumerate(variants.items()):
        keys = jax.random.split(jax.random.key(number), 2 * starts)
        found[variant] = jax.jit(functools.partial(_states, env))(keys[:starts], keys[starts:])
    return Ground(next(iter(variants.values())).stages, found)


def _states(env: envs.Env, reset_keys, state_keys) -> States:
    begin = jax.vmap(env.reset)(reset_keys).objects
    resting = jnp.zeros(begin.label.shape, bool)
    scene = Scene(begin.center, begin.size, begin.label, begin.is_robot, resting)
    return jax.vmap(functools.partial(make_states, task=env.stages))(state_keys, scene)


def audit_program(encoder: GraphConfig, task: StagedTask, *, ascents: int):
    """The jitted audit of many rewards, (parameters, states) -> measures; for any variant."""

    @jax.jit
    def run(params, states):
        def one(params):
            reward, key = scene_reward(encoder), jax.random.key(0)
            found = audit_measures.audit(reward, params, key, task, states, ascents=ascents)
            return found.measures

        return jax.vmap(one)(params)

    return run


def audit_figures(run: Any, params: RewardParams, on: Ground) -> dict[str, Float[np.ndarray, "S"]]:
    """The figures of S rewards, such as `hack_share_layout`."""
    return {
        f"{name}_{variant}": np.asarray(getattr(found, field))
        for variant, found in ((v, run(params, states)) for v, states in on.states.items())
        for name, field in FIGURES.items()
    }
