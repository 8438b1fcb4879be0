"""From where an expert of MatchRegions takes hold of a block.

A gripper closes its finger tips around the block and can then carry it any way, so it comes from
where there is room. A stick can only push, so it comes from behind.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .robots import Robot

__all__ = ["Hold", "choose_dock", "hold"]

_DIRECTIONS = 24
_BLOCK = 0.15  # radius that a block counts as


class Hold(NamedTuple):
    """How a robot takes hold of a block, arena units; distances are from centre to centre."""

    grips: bool  # between its finger tips, or else it pushes with its side
    reach: float  # of a block that it holds
    stand: float  # from where it drives up to the block
    body: float  # radius in which it turns, without fingers
    width: float  # half the width with which it holds
    berth: float  # at which it drives around the block before


def hold(robot: Robot) -> Hold:
    """What is known of each robot."""
    if robot.has_fingers:  # the tips of closing fingers are 0.35 to 0.37 ahead
        return Hold(True, 0.38, 0.62, 0.20, 0.12, 0.55)
    half = robot.parts[0].boxes[0].half
    body = float(np.hypot(*half))
    return Hold(False, 0.19, max(0.34, min(body + 0.2, 0.5)), body, half[0], 0.45)


def choose_dock(
    how: Hold,
    robot: Float[Array, "2"],
    block: Float[Array, "2"],
    blocks: Float[Array, "B 2"],
    other: Bool[Array, "B"],
    wanted: Float[Array, "2"],
    before: Float[Array, "2"],
    *,
    arena: float,
) -> Float[Array, "2"]:
    """The direction along which to drive up to a block: the cheapest of 24, as a unit vector.

    Args:
      how: the robot's way to hold.
      robot: where it is.
      block: where the block is.
      blocks: where all blocks are.
      other: those to keep clear of.
      wanted: unit vector in which the block should move first.
      before: the direction chosen before, kept unless another is clearly better; zero for none.
      arena: half the side.
    """
    angle = np.arange(_DIRECTIONS) * 2 * np.pi / _DIRECTIONS
    fan = jnp.asarray(np.stack([np.cos(angle), np.sin(angle)], axis=1), jnp.float32)
    ways = jnp.concatenate([before[None], wanted[None], fan])
    stand, contact = block - how.stand * ways, block - how.reach * ways

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
    if how.grips:
        cost += 0.35 * turned + 3.0 * crowd(stand, 0.36) + 8.0 * crowd(contact, how.body + 0.02)
        cost += 10.0 * beyond(stand, 0.38) + 30.0 * beyond(contact, how.body + 0.01)
        across = 0.21 * jnp.stack([-ways[:, 1], ways[:, 0]], axis=1)
        for points in (block + across, block - across):  # room for the fingers
            cost += 10.0 * crowd(points, 0.06) + 20.0 * beyond(points, 0.05)
    else:
        cost += 6.0 * turned + 3.0 * crowd(stand, min(how.body, 0.3))
        # Its corners must clear the wall as it stands; being flat, it fits in narrow places.
        thick = 0.07 + how.width * jnp.abs(ways).min(axis=1)
        cost += 30.0 * beyond(stand, thick)
    kept = jnp.where(jnp.sum(before**2) > 0.5, -0.25, 1e3)
    return ways[jnp.argmin(cost.at[0].add(kept))]
