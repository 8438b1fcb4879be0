"""The audit of many rewards of one encoder's shape in one program.

Demo starts are the scene that policies are evaluated in; Layout starts have everything anywhere.
"""

import functools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.experiments.pipeline import setup
from jaxtyping import Float

from gril_jax import envs
from gril_jax.audit import measures
from gril_jax.audit.measures import States, make_states
from gril_jax.audit.scene_reward import Scene, scene_reward
from gril_jax.config import EnvConfig, RunConfig
from gril_jax.encoders.encoder import GraphConfig
from gril_jax.errors import ConfigError
from gril_jax.reward.latent_goal import RewardParams

from .measures import Measure, stacked

VARIANTS = ("demo", "layout")

# Short names of what is kept of `gril_jax.audit.measures.Measures`.
FIGURES = {
    "order": "order_accuracy",
    "touch": "touch_share",
    "push": "push_share",
    "hack_gap": "hack_gap",
    "hack_share": "hack_share",
}


class Ground(NamedTuple):
    """The states that rewards are audited on; the same for all."""

    task: Any  # a `gril_jax.envs.stages.Stages`
    states: Mapping[str, States]  # by variant


def audit(config: EnvConfig, chosen: Sequence[str], *, starts: int, ascents: int) -> Measure:
    """The audit as a measure of a table's rows.

    Each reward has so many ascents for each of the chosen variants, shared by its starts.
    """
    variants = {variant: env for variant, env in tasks(config).items() if variant in chosen}
    num_classes = len(next(iter(variants.values())).classes)

    made = functools.cache(functools.partial(ground, variants, starts=starts))

    def same(config: RunConfig):
        return setup.encoder_config(config, num_classes)

    def lower(config: RunConfig, params: RewardParams):
        run = program(same(config), made().task, ascents=ascents)
        return [run.lower(params, next(iter(made().states.values())))]

    def figures(programs, config, found):
        values = measure(*programs, stacked(found), made())
        return {name: x.tolist() for name, x in values.items()}

    return Measure("audit", figures, same, lower, num_classes)


def tasks(config: EnvConfig) -> dict[str, envs.Env]:
    """The task in each variant; ConfigError if it lacks one of them, or a stage definition."""
    found = {v: setup.make_env(config, training=False, variant=v) for v in VARIANTS}
    if any(getattr(env, "stages", None) is None for env in found.values()):
        raise ConfigError(f"env.name is {config.name!r}, but must be a task with stages")
    return found


def ground(variants: Mapping[str, envs.Env], *, starts: int) -> Ground:
    """Synthetic states around some starts of each variant, which come from `tasks`."""
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
    """The jitted audit of many rewards, (parameters, states) -> measures; for any variant."""

    @jax.jit
    def run(params, states):
        def one(params):
            reward, key = scene_reward(encoder), jax.random.key(0)
            found = measures.audit(reward, params, key, task, states, ascents=ascents)
            return found.measures

        return jax.vmap(one)(params)

    return run


def measure(run: Any, params: RewardParams, on: Ground) -> dict[str, Float[np.ndarray, "S"]]:
    """The figures of S rewards, such as `hack_share_layout`."""
    return {
        f"{name}_{variant}": np.asarray(getattr(found, field))
        for variant, found in ((v, run(params, states)) for v, states in on.states.items())
        for name, field in FIGURES.items()
    }
