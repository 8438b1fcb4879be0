"""Regions: rectangles on the floor that count the centres in them.

A score counts centres; a block that is put into a region is put wholly inside.
"""

import jax.numpy as jnp
from gril_jax.envs.stages import Stage, free_place
from jaxtyping import Array, Bool, Float


def holds(region: Float[Array, "*#K 4"], center: Float[Array, "*#K 2"]) -> Bool[Array, "..."]:
    """True if a centre is in the closed rectangle with that centre, width and height; regions and
    centres are broadcast."""
    return (jnp.abs(center - region[..., :2]) <= region[..., 2:] / 2).all(axis=-1)


def inside(index: int, region: int, name: str, movable: tuple[int, ...]) -> Stage:
    """The stage in which one object's centre is in a region, both given by their index."""

    def done(center, size):
        return (jnp.abs(center[index] - center[region]) <= size[region] / 2).all()

    def within(center, size):
        return center[region] - size[region] / 2, center[region] + size[region] / 2

    def place(key, center, size):
        room = jnp.maximum(size[region] - size[index], 0.0) / 2
        low, high = center[region] - room, center[region] + room
        return free_place(key, index, center, size, low=low, high=high, others=movable)

    return Stage(name, (index,), done, place, within=within)
