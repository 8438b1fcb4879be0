"""Docks: the directions from which a gripper takes hold of a block.

It closes its finger tips around the block and can then carry it any way, so it comes from where
there is room. Distances are from centre to centre, arena units.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

REACH = 0.38  # of a block that it holds: the tips of closing fingers are 0.35 to 0.37 ahead
STAND = 0.62  # from where it drives up to the block
BODY = 0.20  # radius without fingers
WIDTH = 0.12  # half the width with which it holds
BERTH = 0.55  # at which it drives around the block before
_DIRECTIONS = 24
_BLOCK = 0.15  # radius that a block counts as


def choose_dock(
    robot: Float[Array, "2"],
    block: Float[Array, "2"],
    blocks: Float[Array, "B 2"],
    other: Bool[Array, "B"],
    wanted: Float[Array, "2"],
    before: Float[Array, "2"],
    *,
    arena: float,
) -> Float[Array, "2"]:
    """The direction from which to approach a block: the cheapest of 24, as a unit vector.

    `other` marks the blocks to keep clear of, `wanted` is the unit vector in which the block should
    move first. The direction `before`, zero for none, is kept unless another is clearly better.
    """
    angle = np.arange(_DIRECTIONS) * 2 * np.pi / _DIRECTIONS
    fan = jnp.asarray(np.stack([np.cos(angle), np.sin(angle)], axis=1), jnp.float32)
    ways = jnp.concatenate([before[None], wanted[None], fan])
    stand, contact = block - STAND * ways, block - REACH * ways

    def crowd(points, radius):
        apart = jnp.sqrt(jnp.sum((points[:, None] - blocks) ** 2, axis=-1) + 1e-12)
        return jnp.where(other, jnp.maximum(radius + _BLOCK - apart, 0.0), 0.0).sum(axis=1)

    def beyond(points, margin):
        return jnp.maximum(jnp.abs(points).max(axis=1) - (arena - margin), 0.0)

    turned = 1.0 - ways @ wanted
    far = jnp.sqrt(jnp.sum((stand - robot) ** 2, axis=1) + 1e-12)
    # To stand behind the block as seen from here costs a way around it.
    around = jnp.where(jnp.sum((block - robot) * (stand - block), axis=1) > 0, 0.5, 0.0)
    cost = 0.3 * (far + around)
    cost += 0.35 * turned + 3.0 * crowd(stand, 0.36) + 8.0 * crowd(contact, BODY + 0.02)
    cost += 10.0 * beyond(stand, 0.38) + 30.0 * beyond(contact, BODY + 0.01)
    across = 0.21 * jnp.stack([-ways[:, 1], ways[:, 0]], axis=1)
    for points in (block + across, block - across):  # room for the fingers
        cost += 10.0 * crowd(points, 0.06) + 20.0 * beyond(points, 0.05)
    kept = jnp.where(jnp.sum(before**2) > 0.5, -0.25, 1e3)
    return ways[jnp.argmin(cost.at[0].add(kept))]
