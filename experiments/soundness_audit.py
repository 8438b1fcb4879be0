"""The audit of many rewards of one encoder's shape in one program, for an ablation of soundness.

Demo starts are the scene that policies are evaluated in; Layout starts have everything anywhere.
"""

import functools
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gril_jax import audit_measures, envs
from gril_jax.audit_measures import States, make_states
from gril_jax.audit_scene import Scene, scene_reward
from gril_jax.config import EnvConfig
from gril_jax.encoder import GraphConfig
from gril_jax.errors import ConfigError
from gril_jax.reward import RewardParams

from . import setup

__all__ = ["FIGURES", "VARIANTS", "Ground", "ground", "measure", "tasks"]

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
    return Ground(variants[VARIANTS[0]].stages, found)


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
