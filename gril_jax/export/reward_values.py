"""A check that a reward is a number: of a file whose arrays are finite, latents may overflow."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gril_jax.encoders.encoder import AnyConfig, PixelConfig
from gril_jax.graphs.scene import scene_graph
from gril_jax.reward.latent_goal import RewardParams, latent_goal_reward
from gril_jax.reward.learned_reward import LearnedReward

from .reward_format import RewardFileError

_LARGEST = 1e12  # of a reward; those of videos are between about -3 and 0
_OBJECTS = 8  # at most, of a scene
_PIXELS = 32  # of a picture's side


def check_values(learned: LearnedReward, half_extent: float | None, where: str) -> None:
    """Raises RewardFileError unless the reward is a number of usual size in plain scenes."""
    config = learned.config
    if isinstance(config, PixelConfig):
        config = dataclasses.replace(config, pixels=_PIXELS)  # which has the same arrays
    values = np.abs(_plain(learned.params, half_extent or 1.0, config=config))
    if not (values < _LARGEST).all():
        raise RewardFileError(
            f"{where}: the reward of a plain scene is {-values.max():g}, so some of its arrays "
            "hold numbers that are too large; train the reward again."
        )


@functools.partial(jax.jit, static_argnames="config")
def _plain(
    params: RewardParams, half_extent: Float[Array, ""] | float, *, config: AnyConfig
) -> Float[Array, "S"]:
    """The rewards of two pictures, or of two scenes: with all in the middle, and at corners."""
    if isinstance(config, PixelConfig):
        frames = jnp.stack([jnp.full((_PIXELS, _PIXELS, 3), grey) for grey in (0.0, 1.0)])
        return latent_goal_reward(params, frames, config)
    label = jnp.arange(min(config.num_classes, _OBJECTS))
    sides = jnp.stack([label % 2, label // 2 % 2], axis=1)
    size = jnp.full(sides.shape, 0.1 * half_extent)

    def value(far: Float[Array, ""]) -> Float[Array, ""]:
        center = far * half_extent * (2.0 * sides - 1.0)
        graph = scene_graph(center, size, label, label == 0, label > 0)
        return latent_goal_reward(params, graph, config)

    return jax.vmap(value)(jnp.array([0.0, 1.0]))
