"""The audit of many rewards of one encoder's shape in one program, for an ablation of soundness.

Demo starts are the scene that policies are evaluated in; Layout starts have everything anywhere.
"""

import functools
from collections.abc import Hashable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gril_jax import audit_measures, envs, run_dir
from gril_jax.audit_measures import States, make_states
from gril_jax.audit_scene import Scene, scene_reward
from gril_jax.config import EnvConfig
from gril_jax.encoder import GraphConfig
from gril_jax.errors import ConfigError
from gril_jax.progress import Progress
from gril_jax.reward import RewardParams

from . import setup
from .sweep_rewards import LearnedReward, reward_key
from .sweep_rows import Row

__all__ = ["FIGURES", "VARIANTS", "Ground", "audit", "ground", "measure", "tasks"]

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


def measure(
    encoder: GraphConfig, params: RewardParams, on: Ground, *, ascents: int
) -> dict[str, Float[np.ndarray, "S"]]:
    """The figures of S rewards, such as `hack_share_layout`.

    Args:
      encoder: of all of them.
      params: with a leading axis S.
      on: from `ground`.
      ascents: for each reward and variant, shared by the starts.
    """
    program = _program(encoder, on.task, ascents)
    return {
        f"{name}_{variant}": np.asarray(getattr(found, field))
        for variant, found in ((v, program(params, states)) for v, states in on.states.items())
        for name, field in FIGURES.items()
    }


def audit(
    variants: Mapping[str, envs.Env],
    rows: Sequence[Row],
    rewards: Mapping[Hashable, LearnedReward],
    run: run_dir.RunDir,
    progress: Progress,
    *,
    starts: int,
    ascents: int,
) -> None:
    """The figures of each cell's rewards, as a phase of the run that is named after the cell.

    Args:
      variants: from `tasks`, all or some of them.
      rows: of which those of one cell have encoders of one shape.
      rewards: by `sweep_rewards.reward_key`.
      run: keeps the figures; what it has already is not done again.
      progress: shows how far it is.
      starts: that an audit begins from, of each variant.
      ascents: as for `measure`.
    """
    cells = dict.fromkeys(row.cell for row in rows)
    left = [cell for cell in cells if run.finished_phase(f"audit-{cell}") is None]
    if not left:
        return
    phase = progress.phase("auditing", total=len(left), unit="rows")
    on = ground(variants, starts=starts)
    for done, cell in enumerate(left, 1):
        members = [row for row in rows if row.cell == cell]
        found = [rewards[reward_key(row.config)] for row in members]
        params = jax.tree.map(lambda *x: jnp.stack(x), *(one.params for one in found))
        encoder = setup.encoder_config(members[0].config, found[0].num_classes)
        figures = measure(encoder, params, on, ascents=ascents)
        run.finish_phase(f"audit-{cell}", {name: x.tolist() for name, x in figures.items()})
        phase.update(done)


@functools.cache
def _program(encoder: GraphConfig, task: Any, ascents: int):
    """One program for all variants, and for all calls with as many rewards."""

    @jax.jit
    def run(params, states):
        def one(params):
            reward, key = scene_reward(encoder), jax.random.key(0)
            found = audit_measures.audit(reward, params, key, task, states, ascents=ascents)
            return found.measures

        return jax.vmap(one)(params)

    return run
