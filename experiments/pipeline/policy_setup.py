"""From a configuration to the algorithm that trains a policy, and its traced values."""

import math
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from gril_jax import envs
from gril_jax.config import PPOConfig, RunConfig, SACConfig
from gril_jax.errors import RunError
from gril_jax.rl import ppo, sac, training
from gril_jax.rl.policy import Policy
from gril_jax.runs.checkpoints import checkpoint

from . import policy_rewards, setup

__all__ = [
    "algorithm_hyper",
    "fresh_policy",
    "make_algorithm",
    "make_ppo",
    "make_sac",
    "policy_config",
    "ppo_hyper",
    "restore_policy",
    "sac_hyper",
]


def make_ppo(config: RunConfig, env: envs.Env) -> ppo.PPO:
    """The algorithm on the configuration's reward."""
    static = _static(ppo.Static, config, config.ppo)
    return ppo.PPO(env, policy_rewards.function(config, env), static)


def make_sac(config: RunConfig, env: envs.Env) -> sac.SAC:
    """The same for soft actor-critic.

    Raises:
      ConfigError: the reward cannot be relabelled, but should be.
    """
    static = _static(sac.Static, config, config.sac)
    return sac.SAC(env, policy_rewards.function(config, env), static)


def _static(kind: Any, config: RunConfig, chosen: PPOConfig | SACConfig) -> Any:
    """The fields of an algorithm's static half, from its section or from that of the activity."""
    seen = chosen.observe_activity
    seen = config.env.observation != "xmagical" if seen is None else seen
    return setup.by_name(kind, config.pool, chosen, observe_activity=seen)


def make_algorithm(config: RunConfig, env: envs.Env) -> training.Algorithm:
    """The algorithm that the run asks for."""
    return make_sac(config, env) if config.run.algorithm == "sac" else make_ppo(config, env)


def algorithm_hyper(config: RunConfig) -> ppo.Hyper | sac.Hyper:
    """The traced half of it."""
    return sac_hyper(config) if config.run.algorithm == "sac" else ppo_hyper(config)


def policy_config(config: RunConfig) -> PPOConfig | SACConfig:
    """The section of the algorithm that the run asks for."""
    return config.sac if config.run.algorithm == "sac" else config.ppo


def ppo_hyper(config: RunConfig) -> ppo.Hyper:
    """The traced half of policy training, as arrays: another value does not recompile."""
    return _hyper(ppo.Hyper, config, config.ppo)


def sac_hyper(config: RunConfig) -> sac.Hyper:
    """The same for soft actor-critic."""
    return _hyper(sac.Hyper, config, config.sac)


def _hyper(kind: Any, config: RunConfig, chosen: PPOConfig | SACConfig) -> Any:
    updates = math.ceil(chosen.num_timesteps / (chosen.num_envs * chosen.unroll_length))
    found = setup.by_name(kind, config.pool, chosen, decay_updates=updates)
    return kind(*(jnp.asarray(value, jnp.float32) for value in found))


def restore_policy(folder: Path, config: RunConfig, algorithm: training.Algorithm) -> Policy:
    """The policy of a run.

    Raises:
      RunError: the run has none yet, or it is damaged.
    """
    found = checkpoint.latest(folder / "policy")
    if found is None:
        raise RunError(f"{folder} has no policy, so its run has not got that far yet")
    return checkpoint.restore(found, fresh_policy(config, algorithm, jax.random.key(0)))


def fresh_policy(config: RunConfig, algorithm: training.Algorithm, key: PRNGKeyArray) -> Policy:
    """A policy that has learned nothing; of `init` only what makes it is compiled."""
    make = jax.jit(lambda key, hyper: algorithm.policy(algorithm.init(key, hyper)))
    return make(key, algorithm_hyper(config))
