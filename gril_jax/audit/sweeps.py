"""States on a grid over the plane: each object swept alone, or all targets moved together.

Shapes use N for objects, M for those that can move, the robot's last, and G for a side of the grid.
Rows of a grid go up in y, columns to the right in x.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .scene_reward import Scene, StagedTask, activity_bits


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


def pushed(task: StagedTask, start: Scene, *, side: int) -> tuple[Scene, Bool[Array, "G G"]]:
    """Moves the objects of all stages to one place, side by side; those that stick out, further in.

    Returns:
      States with leading axes (G, G), G = `side`, and where true progress is 0.
    """
    limit = task.limit(start.size)
    which = jnp.array(sorted({index for stage in task.stages for index in stage.moves}))
    width = start.size[which, 0]
    offset = jnp.cumsum(width) - width / 2 - jnp.sum(width) / 2

    def at(place):
        row = jnp.stack([place[0] + offset, jnp.broadcast_to(place[1], offset.shape)], axis=1)
        row = jnp.clip(row, -limit[which], limit[which])
        return _scene(task, start, start.center.at[which].set(row))

    scenes = jax.vmap(jax.vmap(at))(grid(task.half_extent, side))
    progress = jax.vmap(jax.vmap(task.progress))
    return scenes, progress(scenes.center, scenes.size) <= 0


def _scene(task, start, center):
    center = task.possible(center, start.size)
    size = task.sizes(center, start.size)
    return start._replace(center=center, size=size, active=activity_bits(start, center))
