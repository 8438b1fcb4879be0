"""A state as input of a reward, a reward as a function of such states, and the task that has them.

Shapes use N for objects; `*S` are any leading axes.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from gril_jax.encoders import encoder
from gril_jax.encoders.encoder import AnyConfig, GraphConfig
from gril_jax.errors import ConfigError
from gril_jax.graphs.scene import scene_graph
from gril_jax.reward.latent_goal import latent_reward

_MOVED = 1e-4  # world units: less is rounding


class Scene(NamedTuple):
    """States: the arguments of `gril_jax.graphs.scene_graph`."""

    center: Float[Array, "*S N 2"]  # world units
    size: Float[Array, "*S N 2"]
    label: Int[Array, "*S N"]
    is_robot: Bool[Array, "*S N"]
    active: Bool[Array, "*S N"]


@runtime_checkable
class StagedTask(Protocol):
    """A task in stages, as `gril_jax.envs.stages.Stages` has and documents them."""

    stages: Sequence[Any]  # in their order; each says whether it holds, and places its objects
    faults: Sequence[Any]
    movable: tuple[int, ...]
    robots: tuple[int, ...]
    half_extent: float  # world units
    sizes: Callable[..., Any]
    possible: Callable[..., Any]  # the nearest centres that the scene's mechanics allow
    progress: Callable[..., Any]  # from 0 to 1
    limit: Callable[..., Any]
    arrange: Callable[..., Any]
    fulfil: Callable[..., Any]
    astray: Callable[..., Any]
    scatter: Callable[..., Any]


SceneReward = Callable[[Any, Scene], Float[Array, ""]]  # (parameters, one state) -> reward


def scene_reward(config: AnyConfig) -> SceneReward:
    """The learned reward (Eq. 7) of one state; its parameters are a `RewardParams`.

    Where the latent is not finite the reward is NaN.

    Raises:
      ConfigError: the encoder takes pictures.
    """
    if not isinstance(config, GraphConfig):
        raise ConfigError(f"the encoder is a {type(config).__name__}; it must take boxes.")

    def reward(params: Any, scene: Scene) -> Float[Array, ""]:
        graph = scene_graph(*scene)
        latent = encoder.apply(params.encoder, graph, config, alpha=params.alpha)
        paid = latent_reward(params, latent)
        # The distance of a NaN counts as 0, which would be the best reward of all.
        known = jnp.isfinite(latent).all() & jnp.isfinite(params.goal).all()
        return jnp.where(known, paid, jnp.nan)

    return reward


def can_move(task: StagedTask, scene: Scene) -> Bool[Array, "N"]:
    """True for the objects that the robot can move, and for itself."""
    return jnp.array([i in (*task.movable, *task.robots) for i in range(len(scene.center))])


def activity_bits(start: Scene, center: Float[Array, "N 2"]) -> Bool[Array, "N"]:
    """The bits (Eq. 4) of objects that have left their start; then of the robot as well."""
    moved = jnp.sum((center - start.center) ** 2, axis=1) > _MOVED**2
    return moved | (start.is_robot & moved.any())
