"""From a configuration to the algorithm that trains a policy, and its traced values."""

import math
from pathlib import Path

import jax
import jax.numpy as jnp

from gril_jax import checkpoint, envs
from gril_jax.config import PPOConfig, RunConfig, SACConfig
from gril_jax.errors import RunError
from gril_jax.rl import ppo, sac, training
from gril_jax.rl.policy import Policy

from . import policy_rewards

__all__ = [
    "algorithm_hyper",
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
    chosen = config.ppo
    static = ppo.Static(
        num_envs=chosen.num_envs,
        unroll_length=chosen.unroll_length,
        num_minibatches=chosen.num_minibatches,
        num_epochs=chosen.num_epochs,
        hidden=chosen.hidden,
        observe_activity=chosen.observe_activity,
        window=config.pool.window,
        smoothing=config.pool.smoothing,
        noise=config.pool.noise,
    )
    return ppo.PPO(env, policy_rewards.function(config, len(env.classes)), static)


def make_sac(config: RunConfig, env: envs.Env) -> sac.SAC:
    """The same for soft actor-critic.

    Raises:
      ConfigError: the reward cannot be relabelled, but should be.
    """
    chosen = config.sac
    static = sac.Static(
        num_envs=chosen.num_envs,
        unroll_length=chosen.unroll_length,
        updates_per_step=chosen.updates_per_step,
        batch_size=chosen.batch_size,
        replay_size=chosen.replay_size,
        min_replay=chosen.min_replay,
        relabel=chosen.relabel,
        hidden=chosen.hidden,
        observe_activity=chosen.observe_activity,
        window=config.pool.window,
        smoothing=config.pool.smoothing,
        noise=config.pool.noise,
    )
    return sac.SAC(env, policy_rewards.function(config, len(env.classes)), static)


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
    chosen = config.ppo
    hyper = ppo.Hyper(
        learning_rate=chosen.learning_rate,
        discounting=chosen.discounting,
        gae_lambda=chosen.gae_lambda,
        entropy_cost=chosen.entropy_cost,
        clipping_epsilon=chosen.clipping_epsilon,
        reward_scaling=chosen.reward_scaling,
        max_grad_norm=chosen.max_grad_norm,
        tau=config.pool.tau,
        decay_updates=math.ceil(chosen.num_timesteps / (chosen.num_envs * chosen.unroll_length)),
        learning_rate_left=chosen.learning_rate_left,
        entropy_left=chosen.entropy_left,
    )
    return jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), hyper)


def sac_hyper(config: RunConfig) -> sac.Hyper:
    """The same for soft actor-critic."""
    chosen = config.sac
    hyper = sac.Hyper(
        learning_rate=chosen.learning_rate,
        alpha_learning_rate=chosen.alpha_learning_rate,
        initial_alpha=chosen.initial_alpha,
        target_entropy=chosen.target_entropy,
        discounting=chosen.discounting,
        soft_update=chosen.soft_update,
        reward_scaling=chosen.reward_scaling,
        max_grad_norm=chosen.max_grad_norm,
        tau=config.pool.tau,
    )
    return jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), hyper)


def restore_policy(folder: Path, config: RunConfig, algorithm: training.Algorithm) -> Policy:
    """The policy of a run.

    Raises:
      RunError: the run has none yet, or it is damaged.
    """
    found = checkpoint.latest(folder / "policy")
    if found is None:
        raise RunError(f"{folder} has no policy, so its run has not got that far yet")
    fresh = jax.jit(algorithm.init)(jax.random.key(0), algorithm_hyper(config))
    return checkpoint.restore(found, algorithm.policy(fresh))
