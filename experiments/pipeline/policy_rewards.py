"""What a policy is trained on: the reward that the configuration names, and its parameters."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, UInt8

from gril_jax import envs, reward
from gril_jax.config import RunConfig
from gril_jax.encoders.encoder import PixelConfig
from gril_jax.encoders.ensemble import num_members
from gril_jax.errors import ConfigError
from gril_jax.pretraining import pretrain
from gril_jax.reward import chain as subtask_chain
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.rl import rewards
from gril_jax.subtasks import agreement
from gril_jax.types import DemoBatch

from . import setup

__all__ = ["blank", "function", "parameters", "robots"]

_MOST = 8  # subtasks of a chain


def function(config: RunConfig, env: envs.Env) -> rewards.AnyReward:
    """The reward as the algorithms take it."""
    chosen = config.run.reward
    if chosen == "environmental":
        return rewards.environmental
    scene = setup.encoder_config(config, len(env.classes))
    if isinstance(scene, PixelConfig):
        several = jax.device_count() > 1
        learned = rewards.pixels(scene, _picture(config, scene.pixels), side_by_side=several)
        if chosen == "sum":
            return rewards.weighted_sum([learned, rewards.environmental])
        return rewards.offset(learned, config.run.reward_offset)
    known = robots(env)
    if chosen == "subtasks":
        return rewards.subtasks(scene, robots=known, alpha=config.pool.alpha)
    learned = rewards.learned(scene, robots=known)
    if chosen == "sum":
        return rewards.weighted_sum([learned, rewards.environmental])
    if chosen == "shaped":
        return rewards.shaped(learned)
    return rewards.offset(learned, config.run.reward_offset)


def robots(env: envs.Env) -> tuple[int, ...]:
    """Objects that belong to the robot; none of a task that does not say."""
    stages = getattr(env, "stages", None)
    return stages.robots if stages else ()


def _picture(config: RunConfig, pixels: int) -> Callable[[Any], UInt8[Array, "P P 3"]]:
    """The task's own picture of a moment, with smooth edges as in the videos of demonstrations.

    Raises:
      ConfigError: the task cannot be drawn inside compiled code.
    """
    env, border = setup.make_env(config.env, training=False), setup.picture_border(pixels)
    if not hasattr(env, "render"):
        raise ConfigError(
            f"encoder.kind is 'pixels', but must be 'paper', 'interaction' or 'mlp' to train a "
            f"policy for {config.env.name}, which has no pictures inside compiled code"
        )
    inner = slice(border, border + pixels)
    return lambda data: env.render(data, size=pixels + 2 * border, antialias=True)[inner, inner]


def parameters(
    config: RunConfig, learned: RewardParams, demos: DemoBatch | None, num_classes: int
) -> Any:
    """Its parameters, from a learned reward and the demonstrations that it was learned from."""
    chosen = config.run.reward
    if chosen == "environmental":
        return ()
    if chosen == "sum":
        return jnp.asarray(config.run.reward_weights, jnp.float32), (learned, ())
    if chosen == "shaped":
        weights = jnp.asarray(config.run.reward_weights, jnp.float32)
        learner = config.sac if config.run.algorithm == "sac" else config.ppo
        return weights, jnp.float32(learner.discounting), learned
    if chosen == "subtasks":
        assert demos is not None
        return learned.encoder, _chain(config, learned, demos, num_classes)
    return learned


def blank(config: RunConfig, env: envs.Env) -> Any:
    """Parameters of the right shapes, to restore a checkpoint into."""
    learned = setup.blank_reward(config, len(env.classes))
    if config.run.reward != "subtasks":
        return parameters(config, learned, None, len(env.classes))
    goals = jnp.zeros((_MOST, learned.goal.shape[-1]))
    scale = jnp.zeros((_MOST, *learned.scale.shape))  # of each of an ensemble's members
    chain = subtask_chain.ChainParams(goals, scale, jnp.zeros(_MOST), jnp.zeros((), jnp.int32))
    return learned.encoder, chain


def _chain(config: RunConfig, learned: RewardParams, demos: DemoBatch, num_classes: int):
    """The subtasks on which the demonstrations agree, in their order."""
    static = setup.pretrain_config(config, num_classes)
    hyper, members = setup.pretrain_hyper(config), num_members(static.encoder)

    @jax.jit
    def make(learned, demos):
        latents = pretrain.embed(learned.encoder, demos, hyper, static)
        profiles = reward.latent_reward(learned, latents)
        _, found = agreement.agreed_stages(profiles, demos.length)
        # Where a demonstration does not show an end by itself, its latent is not the goal's.
        ends = jnp.where(found.found, found.frames, -1)[:, :_MOST]
        kept = found.kept[:_MOST]
        return subtask_chain.from_latents(latents, ends, demos.length, kept=kept, members=members)

    return make(learned, demos)
