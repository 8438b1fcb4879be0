"""States as inputs of a reward, a reward as a function of them, and states on a grid.

Shapes use N for objects, M for those that can move, the robot's last, and G for a side of the grid;
`*S` are any leading axes. Rows of a grid go up in y, columns to the right in x.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
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
    done: Callable[..., Any]  # the stages that are
    faulty: Callable[..., Any]  # the faults that there are
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


def grid(half_extent: float, side: int) -> Float[Array, "G G 2"]:
    """Equally spaced places over |x|, |y| <= half_extent."""
    line = jnp.linspace(-half_extent, half_extent, side)
    return jnp.stack(jnp.meshgrid(line, line, indexing="xy"), axis=-1)


def alone(task: StagedTask, start: Scene, center: Float[Array, "N 2"], *, side: int) -> Scene:
    """Sweeps each object alone over the plane; the others stay at `center`.

    `start` is the state after a reset, which tells what has moved; outer places of the grid, G =
    `side`, touch the walls with the object's box.

    Returns:
      States with leading axes (M, G, G), in the order of `(*task.movable, *task.robots)`.
    """
    limit = task.limit(start.size)

    def at(index, place):
        return _scene(task, start, center.at[index].set(place * limit[index]))

    over_plane = jax.vmap(jax.vmap(at, (None, 0)), (None, 0))
    indices = jnp.array([*task.movable, *task.robots])
    return jax.vmap(over_plane, (0, None))(indices, grid(1.0, side))


def pushed(task: StagedTask, start: Scene, *, side: int) -> Scene:
    """Moves the objects of all stages to one place, side by side; those that stick out, further in.

    Returns:
      States with leading axes (G, G), G = `side`.
    """
    limit = task.limit(start.size)
    which = jnp.array(sorted({index for stage in task.stages for index in stage.moves}))
    width = start.size[which, 0]
    offset = jnp.cumsum(width) - width / 2 - jnp.sum(width) / 2

    def at(place):
        row = jnp.stack([place[0] + offset, jnp.broadcast_to(place[1], offset.shape)], axis=1)
        row = jnp.clip(row, -limit[which], limit[which])
        return _scene(task, start, start.center.at[which].set(row))

    return jax.vmap(jax.vmap(at))(grid(task.half_extent, side))


def _scene(task, start, center):
    center = task.possible(center, start.size)
    size = task.sizes(center, start.size)
    return start._replace(center=center, size=size, active=activity_bits(start, center))
