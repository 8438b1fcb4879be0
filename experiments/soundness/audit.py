"""The audit of many rewards of one encoder's shape in one program, for an ablation of soundness.

Demo starts are the scene that policies are evaluated in; Layout starts have everything anywhere.
"""

import functools
from collections.abc import Hashable, Mapping, Sequence
from concurrent.futures import Executor, Future
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.experiments.pipeline import setup
from gril_jax.experiments.sweeps.rewards import LearnedReward, reward_key
from gril_jax.experiments.sweeps.rows import Row
from jaxtyping import Float

from gril_jax import envs
from gril_jax.audit import measures
from gril_jax.audit.measures import States, make_states
from gril_jax.audit.scene_reward import Scene, scene_reward
from gril_jax.compilation import ahead
from gril_jax.compilation.compiler import compiled
from gril_jax.config import EnvConfig, RunConfig
from gril_jax.encoders.encoder import GraphConfig
from gril_jax.errors import ConfigError
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.runs import run_dir
from gril_jax.runs.progress import Progress

__all__ = [
    "FIGURES",
    "VARIANTS",
    "Audits",
    "Ground",
    "audit",
    "get_ready",
    "ground",
    "measure",
    "program",
    "tasks",
]

VARIANTS = ("demo", "layout")

# Short names of what is kept of `audit_measures.Measures`.
FIGURES = {
    "order": "order_accuracy",
    "touch": "touch_share",
    "push": "push_share",
    "hack_gap": "hack_gap",
    "hack_share": "hack_share",
}


class Ground(NamedTuple):
    """What rewards are audited on; the same for all."""

    task: Any  # a `gril_jax.envs.stages.Stages`
    states: Mapping[str, States]  # by variant


def tasks(config: EnvConfig) -> dict[str, envs.Env]:
    """The task in each variant.

    Raises:
      ConfigError: it lacks one of them, or has no stage definition.
    """
    found = {v: setup.make_env(config, training=False, variant=v) for v in VARIANTS}
    if any(getattr(env, "stages", None) is None for env in found.values()):
        raise ConfigError(f"env.name is {config.name!r}, but must be a task with stages")
    return found


def ground(variants: Mapping[str, envs.Env], *, starts: int) -> Ground:
    """Made-up states around some starts of each variant, which come from `tasks`."""
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


def program(encoder: GraphConfig, task: Any, *, ascents: int):
    """The jitted audit of many rewards, (parameters, states) -> measures; of any variant.

    Args:
      encoder: of all of them.
      task: a `gril_jax.envs.stages.Stages`.
      ascents: for each reward, shared by the starts.
    """

    @jax.jit
    def run(params, states):
        def one(params):
            reward, key = scene_reward(encoder), jax.random.key(0)
            found = measures.audit(reward, params, key, task, states, ascents=ascents)
            return found.measures

        return jax.vmap(one)(params)

    return run


def measure(run: Any, params: RewardParams, on: Ground) -> dict[str, Float[np.ndarray, "S"]]:
    """The figures of S rewards, such as `hack_share_layout`.

    Args:
      run: from `program`, jitted or compiled.
      params: with a leading axis S.
      on: from `ground`.
    """
    return {
        f"{name}_{variant}": np.asarray(getattr(found, field))
        for variant, found in ((v, run(params, states)) for v, states in on.states.items())
        for name, field in FIGURES.items()
    }


class Wanted(NamedTuple):
    """The rewards of a cell, and their audit, which is being compiled."""

    cell: int
    rows: list[Row]
    ready: Future[Any]


class Audits(NamedTuple):
    """Audits that a run has not made yet."""

    ground: Ground
    cells: list[Wanted]

    @property
    def last(self) -> Future[Any] | None:
        """The program that was asked for last; the others are there with it, or soon after."""
        return self.cells[-1].ready if self.cells else None


def get_ready(
    variants: Mapping[str, envs.Env],
    rows: Sequence[Row],
    run: run_dir.RunDir,
    pool: Executor,
    *,
    starts: int,
    ascents: int,
) -> Audits:
    """Begin to compile, in a pool, the audits that are not among the run's phases.

    Args:
      variants: from `tasks`, all or some of them.
      rows: of which those of one cell have encoders of one shape.
      run: keeps the figures.
      pool: to compile in.
      starts: that an audit begins from, of each variant.
      ascents: for each reward and variant, shared by the starts.
    """
    cells = dict.fromkeys(row.cell for row in rows)
    left = [cell for cell in cells if run.finished_phase(f"audit-{cell}") is None]
    on, found = ground(variants, starts=starts) if left else Ground(None, {}), []
    begun: dict[Any, Future[Any]] = {}
    for cell in left:
        members = [row for row in rows if row.cell == cell]
        config, num_classes = members[0].config, len(next(iter(variants.values())).classes)
        same = (setup.encoder_config(config, num_classes), len(members))
        if same not in begun:
            begun[same] = pool.submit(_compiled, config, *same, on, ascents)
        found.append(Wanted(cell, members, begun[same]))
    return Audits(on, found)


def _compiled(config: RunConfig, encoder: GraphConfig, count: int, on: Ground, ascents: int):
    states = next(iter(on.states.values()))
    with ahead.tracing():
        blank = setup.blank_reward(config, encoder.num_classes)
        params = jax.eval_shape(lambda: jax.tree.map(lambda x: jnp.stack([x] * count), blank))
        found = program(encoder, on.task, ascents=ascents).lower(params, states)
    return compiled(found)


def audit(
    wanted: Audits,
    rewards: Mapping[Hashable, LearnedReward],
    run: run_dir.RunDir,
    progress: Progress,
) -> None:
    """The figures of each cell's rewards, as a phase of the run that is named after the cell.

    Args:
      wanted: from `get_ready`.
      rewards: by `sweep_rewards.reward_key`.
      run: keeps the figures.
      progress: shows how far it is.
    """
    if not wanted.cells:
        return
    phase = progress.phase("auditing", total=len(wanted.cells), unit="rows")
    for done, (cell, members, ready) in enumerate(wanted.cells, 1):
        found = [rewards[reward_key(row.config)] for row in members]
        params = jax.tree.map(lambda *x: jnp.stack(x), *(one.params for one in found))
        figures = measure(ready.result(), params, wanted.ground)
        run.finish_phase(f"audit-{cell}", {name: x.tolist() for name, x in figures.items()})
        phase.update(done)
