"""Builds the algorithm that trains a policy, and reads back what a run has saved of it."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from gril_jax import envs
from gril_jax.config import RunConfig
from gril_jax.config.tables import ALGORITHMS, find
from gril_jax.errors import ConfigError
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.rl import training
from gril_jax.rl.policy import Policy
from gril_jax.runs.checkpoints import checkpoint

from . import policy_rewards, setup
from .vocabulary import Vocabulary


def make_algorithm(config: RunConfig, env: envs.Env, name: str | None = None) -> training.Algorithm:
    """The algorithm that the run asks for, or that of a name, on the run's reward."""
    kind, section = _chosen(config, name)
    seen = section.observe_activity
    seen = config.env.observation != "xmagical" if seen is None else seen
    static = setup.by_name(
        kind.Static, config.pool, section, observe_activity=seen, **config.pool.rule()
    )
    if getattr(section, "precision", "float32") != "float32":
        half = section.precision == "bfloat16" or jax.default_backend() == "gpu"
        static = replace(static, half=half)
    if static.video_state_resets and getattr(env, "place", None) is None:
        raise ConfigError(
            f"{config.run.algorithm}.video_state_resets is {static.video_state_resets}, but "
            f"{config.env.name} cannot place objects where a frame shows them: it has no "
            "place(center, size, key)"
        )
    if getattr(static, "by_object", False) and getattr(env, "observation_rows", None) is None:
        raise ConfigError(
            f"ppo.by_object is true, but must be false for {config.env.name}, whose observation "
            "does not say which numbers are of which object: it has no observation_rows"
        )
    return kind(env, policy_rewards.function(config, env), static)


def algorithm_hyper(config: RunConfig, name: str | None = None) -> Any:
    """The traced half of it, as arrays: another value does not recompile."""
    kind, section = _chosen(config, name)
    updates = math.ceil(section.num_timesteps / (section.num_envs * section.unroll_length))
    found = setup.by_name(kind.Hyper, config.pool, section, decay_updates=updates)
    return kind.Hyper(*(jnp.asarray(value, jnp.float32) for value in found))


def policy_config(config: RunConfig) -> Any:
    """The configuration section of the run's algorithm."""
    return getattr(config, config.run.algorithm)


def _chosen(config: RunConfig, name: str | None) -> tuple[Any, Any]:
    """An algorithm's class and its section."""
    name = name or config.run.algorithm
    section = getattr(config, name)
    if name == "ppo":
        section = replace(section, sub_policies=config.sub_policies)
    return find(ALGORITHMS[name].algorithm), section


def fresh_policy(config: RunConfig, algorithm: training.Algorithm, key: PRNGKeyArray) -> Policy:
    """An untrained policy; compiles only the part of `init` that makes it."""
    make = jax.jit(lambda key, hyper: algorithm.policy(algorithm.init(key, hyper)))
    return make(key, algorithm_hyper(config))


# What a run has saved; a RunError if there is none yet, or if it is damaged.


def restore_policy(folder: Path, config: RunConfig, algorithm: training.Algorithm) -> Policy:
    """The policy of a run."""
    found = checkpoint.newest(folder, "policy")
    return checkpoint.restore(found, fresh_policy(config, algorithm, jax.random.key(0)))


def learned_reward(folder: Path, config: RunConfig, words: envs.Env | Vocabulary) -> RewardParams:
    """The reward that a run has learned; `words` has its classes."""
    found = checkpoint.newest(folder, "reward")
    return checkpoint.restore(found, setup.blank_reward(config, len(words.classes)))


def policy_reward(folder: Path, config: RunConfig, env: envs.Env) -> Any:
    """The parameters of the reward that a run's policy was trained on."""
    found = checkpoint.newest(folder, "policy_reward")
    return checkpoint.restore(found, policy_rewards.blank(config, env))
