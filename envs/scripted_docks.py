"""From where an expert of MatchRegions takes hold of a block.

A gripper closes its finger tips around the block and can then carry it any way, so it comes from
where there is room. A stick can only push, so it comes from behind.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .robots import Robot

__all__ = ["Hold", "choose_dock", "grip_hold", "push_hold"]

_DIRECTIONS = 24
import os
_GRIP=float(os.environ.get('G','0'))
_BLOCK = 0.15  # radius that a block counts as


class Hold(NamedTuple):
    """How a robot takes hold of a block, arena units; distances are from centre to centre."""

    grips: Bool[Array, ""]  # between its finger tips, or else it pushes with what is in front
    reach: Float[Array, ""]  # of a block that it holds
    stand: Float[Array, ""]  # from where it drives up to the block
    body: Float[Array, ""]  # radius in which it turns, without fingers
    width: Float[Array, ""]  # half the width with which it holds


def push_hold(robot: Robot) -> Hold:
    """How a robot pushes: a stick with its side, a gripper with the tips of closed fingers."""
    if robot.has_fingers:
        return _hold(False, 0.46, 0.62, 0.20, 0.12)
    half = robot.parts[0].boxes[0].half
    body = float(np.hypot(*half))
    return _hold(False, 0.17, max(0.34, min(body + 0.2, 0.5)), body, half[0])


def grip_hold(star: Bool[Array, ""]) -> Hold:
    """How a gripper carries: the tips of its fingers close 0.35 to 0.37 ahead."""
    reach = jnp.where(star, float(os.environ.get('SR','0.38')), float(os.environ.get('R','0.38')))
    return _hold(True, reach, 0.62, 0.20, 0.12)


def _hold(grips, *lengths) -> Hold:
    return Hold(jnp.asarray(grips), *(jnp.float32(x) for x in lengths))


def choose_dock(
    robot: Robot,
    place: Float[Array, "2"],
    block: Float[Array, "2"],
    blocks: Float[Array, "B 2"],
    other: Bool[Array, "B"],
    wanted: Float[Array, "2"],
    before: Float[Array, "2"],
    gripping: Bool[Array, ""],
    star: Bool[Array, ""],
    *,
    arena: float,
) -> tuple[Float[Array, "2"], Bool[Array, ""]]:
    """The direction along which to drive up to a block (unit vector), and whether to grip it.

    Args:
      robot: which robot.
      place: where it is.
      block: where the block is.
      blocks: where all blocks are.
      other: those to keep clear of.
      wanted: unit vector in which the block should move first.
      before: the direction chosen before, kept unless another is clearly better; zero for none.
      gripping: what was chosen with it.
      arena: half the side.
    """
    angle = np.arange(_DIRECTIONS) * 2 * np.pi / _DIRECTIONS
    fan = jnp.asarray(np.stack([np.cos(angle), np.sin(angle)], axis=1), jnp.float32)
    ways = jnp.concatenate([before[None], wanted[None], fan])
    kept = jnp.where(jnp.sum(before**2) > 0.5, -0.25, 1e3)

    def costs(how: Hold):
        stand, contact = block - how.stand * ways, block - how.reach * ways

        def crowd(points, radius):
            apart = jnp.sqrt(jnp.sum((points[:, None] - blocks) ** 2, axis=-1) + 1e-12)
            return jnp.where(other, jnp.maximum(radius + _BLOCK - apart, 0.0), 0.0).sum(axis=1)

        def beyond(points, margin):
            return jnp.maximum(jnp.abs(points).max(axis=1) - (arena - margin), 0.0)

        turned = 1.0 - ways @ wanted
        far = jnp.sqrt(jnp.sum((stand - place) ** 2, axis=1) + 1e-12)
        # To stand behind the block as seen from here costs a way around it.
        around = jnp.where(jnp.sum((block - place) * (stand - block), axis=1) > 0, 0.5, 0.0)
        cost = 0.3 * (far + around) + 3.0 * crowd(stand, 0.36 if robot.has_fingers else jnp.minimum(how.body, 0.3))
        if robot.has_fingers:
            cost += 8.0 * crowd(contact, how.body + 0.02)
            cost += 10.0 * beyond(stand, 0.38) + 30.0 * beyond(contact, how.body + 0.01)
        else:
            # Its corners must clear the wall as it stands; being flat, it fits in narrow places.
            thick = 0.07 + how.width * jnp.abs(ways).min(axis=1)
            cost += 30.0 * beyond(stand, thick)
        return cost, turned, beyond, crowd

    cost, turned, _, _ = costs(push_hold(robot))
    push = cost + (2.0 if robot.has_fingers else 6.0) * turned
    push = push.at[0].add(jnp.where(gripping, 1e3, kept))
    if not robot.has_fingers:
        return ways[jnp.argmin(push)], jnp.asarray(False)
    cost, turned, beyond, crowd = costs(grip_hold(star))
    across = jnp.stack([-ways[:, 1], ways[:, 0]], axis=1)
    grip = cost + 0.35 * turned + jnp.where(star, float(os.environ.get('SG','-3')), float(os.environ.get('G','-3')))
    for points in (block + 0.21 * across, block - 0.21 * across):  # room for the fingers
        grip += 10.0 * crowd(points, 0.06) + 20.0 * beyond(points, 0.05)
    grip = grip.at[0].add(jnp.where(gripping, kept, 1e3))
    grips = grip.min() < push.min()
    return ways[jnp.where(grips, jnp.argmin(grip), jnp.argmin(push))], grips
