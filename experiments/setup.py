"""From a configuration to the objects that the experiments compose."""

import contextlib
import dataclasses
import io
import math

import jax
import jax.numpy as jnp

from gril_jax import encoder, envs, pretrain
from gril_jax.config import EnvConfig, RunConfig
from gril_jax.errors import ConfigError
from gril_jax.reward import RewardParams
from gril_jax.rl import ppo, rewards, sac, training

__all__ = [
    "algorithm_hyper",
    "blank_reward",
    "device_in_words",
    "encoder_config",
    "make_algorithm",
    "make_env",
    "make_ppo",
    "make_sac",
    "ppo_hyper",
    "pretrain_config",
    "pretrain_hyper",
    "sac_hyper",
]


def make_env(config: EnvConfig, *, training: bool, variant: str | None = None) -> envs.Env:
    """The task; varied starts belong to training alone.

    Raises:
      ConfigError: the task does not offer what the configuration asks for.
    """
    options = dataclasses.asdict(config) | {
        "variant": variant or config.variant,
        "varied_starts": config.varied_starts if training else 0.0,
    }
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # mjx reports on optional parts
            return envs.make(options.pop("name"), **options)
    except ValueError as error:
        raise ConfigError(f"env: {error}") from error


def encoder_config(config: RunConfig, num_classes: int) -> encoder.GraphConfig:
    """The encoder's sizes and options."""
    chosen = config.encoder
    robot = {"pool_robot": chosen.pool_robot}
    if chosen.kind == "mlp":
        return encoder.MLPConfig(num_classes, width=chosen.width, **robot)
    robot["robot_messages"] = chosen.robot_messages
    if chosen.kind == "interaction":
        return encoder.InteractionConfig(num_classes, width=chosen.width, **robot)
    sizes = {"width": chosen.width, "rounds": chosen.rounds, "latent": chosen.latent}
    return encoder.EncoderConfig(num_classes, **sizes, **robot)


def pretrain_config(config: RunConfig, num_classes: int) -> pretrain.PretrainConfig:
    """The static half of encoder training; `updates` is one call's share of all steps."""
    chosen = config.pretrain
    updates = next(n for n in (100, 50, 20, 10, 5, 2, 1) if chosen.steps % n == 0)
    return pretrain.PretrainConfig(
        encoder=encoder_config(config, num_classes),
        consistency=config.loss.consistency,
        form=config.loss.form,
        matching=config.loss.matching,
        similarity=config.loss.similarity,
        decoder=config.loss.decoder,
        updates=updates,
        num_videos=chosen.num_videos,
        num_frames=chosen.num_frames,
        window=config.pool.window,
        smoothing=config.pool.smoothing,
        noise=config.pool.noise,
        turn_scenes=chosen.turn_scenes,
        touched=chosen.touched,
    )


def pretrain_hyper(config: RunConfig) -> pretrain.Hyper:
    """The traced half of encoder training."""
    return pretrain.Hyper(
        learning_rate=config.pretrain.learning_rate,
        lambda_=config.loss.lambda_,
        temperature=config.loss.temperature,
        soft_dtw_weight=config.loss.soft_dtw_weight,
        gamma=config.loss.gamma,
        warmup=float(config.loss.warmup),
        alpha=config.pool.alpha,
        tau=config.pool.tau,
    )


def blank_reward(config: RunConfig, num_classes: int) -> RewardParams:
    """Reward parameters of the right shapes, to restore a checkpoint into."""
    chosen = encoder_config(config, num_classes)
    zero = jnp.zeros((), jnp.float32)
    return RewardParams(
        encoder.init(jax.random.key(0), chosen), jnp.zeros(chosen.latent), zero, zero
    )


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
    return ppo.PPO(env, _reward(config, env), static)


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
    return sac.SAC(env, _reward(config, env), static)


def make_algorithm(config: RunConfig, env: envs.Env) -> training.Algorithm:
    """The algorithm that the run asks for."""
    return make_sac(config, env) if _algorithm(config) == "sac" else make_ppo(config, env)


def algorithm_hyper(config: RunConfig) -> ppo.Hyper | sac.Hyper:
    """The traced half of it."""
    return sac_hyper(config) if _algorithm(config) == "sac" else ppo_hyper(config)


def _algorithm(config: RunConfig) -> str:
    return getattr(config.run, "algorithm", "ppo")


def _reward(config: RunConfig, env: envs.Env) -> rewards.AnyReward:
    if config.run.reward == "environmental":
        return rewards.environmental
    return rewards.learned(encoder_config(config, len(env.classes)))


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


def device_in_words() -> str:
    """What JAX computes on, such as "2 x cpu"."""
    devices = jax.devices()
    return f"{len(devices)} x {devices[0].device_kind}"
