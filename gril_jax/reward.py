"""The learned reward: minus the latent distance to the goal (Eq. 7 of the paper).

    params = reward.from_demos(encoder_params, demos, config)
    graph = graphs.scene_graph(center, size, label, is_robot, active)
    r = reward.latent_goal_reward(params, graph, config)

Goal and scale are XIRL's: the goal is the mean latent of the demonstrations' last frames, the
scale makes the reward about -1 at their first frames. Shapes use B for demonstrations, T for
frames, N for objects and D for the latent. The reward takes one graph; batch with `jax.vmap`,
over graphs or over the parameters of many seeds alike.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from . import activity, encoder
from .encoder import EncoderConfig, Params
from .graphs import safe_norm, scene_graph
from .types import DemoBatch, SceneGraph

__all__ = ["RewardParams", "from_demos", "latent_goal_reward"]


class RewardParams(NamedTuple):
    """Everything the reward needs at run time; freeze it, save it, hand it on."""

    encoder: Params
    goal: Float[Array, "D"]  # mean latent of the demonstrations' last frames
    scale: Float[Array, ""]  # reward units per unit of latent distance
    alpha: Float[Array, ""]  # weight of an active node in the pooling (Eq. 3)


def latent_goal_reward(
    params: RewardParams, graph: SceneGraph, config: EncoderConfig
) -> Float[Array, ""]:
    """Minus the latent distance to the goal (Eq. 7): at most 0, and 0 at the goal.

    At the goal itself the gradient is zero, not NaN.
    """
    latent = encoder.apply(params.encoder, graph, config, alpha=params.alpha)
    return -params.scale * safe_norm(latent - params.goal)


@functools.partial(jax.jit, static_argnames="window")
def from_demos(
    encoder_params: Params,
    demos: DemoBatch,
    config: EncoderConfig,
    *,
    alpha: Float[Array, ""] | float = 5.0,
    tau: Float[Array, ""] | float = 0.005,
    window: int = 40,
) -> RewardParams:
    """The reward of a trained encoder, with goal and scale from its demonstrations.

    Args:
      encoder_params: from `gril_jax.encoder.init`, trained.
      demos: the training demonstrations; each must end with the task done.
      config: of the encoder.
      alpha: weight of an active node in the pooling (Eq. 3).
      tau: activity threshold in box diagonals (Eq. 4).
      window: activity window in frames (Eq. 4).

    Returns:
      Reward parameters. If every demonstration begins where it ends, as far as the encoder can
      tell, there is no distance to scale by and the scale is 1.
    """
    alpha = jnp.asarray(alpha, jnp.float32)

    def ends(center, size, label, is_robot, present, length):
        active = activity.trajectory(center, size, tau=tau, window=window)

        def latent(frame):
            graph = scene_graph(center[frame], size[frame], label, is_robot, active[frame], present)
            return encoder.apply(encoder_params, graph, config, alpha=alpha)

        return latent(jnp.zeros_like(length)), latent(length - 1)

    first, last = jax.vmap(ends)(*demos)
    goal = jnp.mean(last, axis=0)
    distance = jnp.mean(safe_norm(first - goal))
    scale = 1.0 / jnp.where(distance > 0, distance, 1.0)
    return RewardParams(encoder_params, goal, scale, alpha)
