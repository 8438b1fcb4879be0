"""Ways of a gripper: where it takes hold of a block, and the shortest paths there, inside jit.

A dock is the direction from which it comes to close its finger tips around the block. Paths lead
around round obstacles on a grid of 25 x 25 points: going costs its length, and more the deeper it
leads into an obstacle's margin, so that there always is a way. Distances are from centre to centre,
arena units.
"""

from typing import NamedTuple

import jax
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
_POINTS = 25
_SWEEPS = 44  # a way over more points than this is not found; the arena's side has 25
_AHEAD = 0.4  # how far a point to head for is, at most
_PENALTY = 12.0  # times dearer at an obstacle's centre than in the open


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


class Obstacles(NamedTuple):
    """Discs to keep away from; one that does not count has radius 0."""

    center: Float[Array, "M 2"]
    radius: Float[Array, "M"]  # at which it begins to cost
    limit: Float[Array, ""]  # |x| or |y| at which the wall begins to cost


def _grid(extent: float) -> Float[Array, "G G 2"]:
    axis = jnp.linspace(-extent, extent, _POINTS)
    return jnp.stack(jnp.meshgrid(axis, axis, indexing="ij"), axis=-1)


def _price(points: Float[Array, "*P 2"], obstacles: Obstacles) -> Float[Array, "*P"]:
    """Cost per unit of length at each point."""
    away = points[..., None, :] - obstacles.center
    distance = jnp.sqrt(away[..., 0] ** 2 + away[..., 1] ** 2 + 1e-12)
    radius = jnp.maximum(obstacles.radius, 1e-6)
    depth = jnp.maximum(1.0 - distance / radius, 0.0) * (obstacles.radius > 0)
    wall = jnp.maximum(jnp.abs(points).max(axis=-1) - obstacles.limit, 0.0)
    return 1.0 + _PENALTY * (depth.sum(axis=-1) + 5.0 * wall)


def cost_to_go(
    target: Float[Array, "2"], obstacles: Obstacles, *, extent: float
) -> Float[Array, "G G"]:
    """Cost of the best path from each point of a grid |x|, |y| <= `extent` to `target`."""
    grid = _grid(extent)
    price = _price(grid, obstacles)
    spacing = 2 * extent / (_POINTS - 1)
    reach = jnp.sqrt(jnp.sum((grid - target) ** 2, axis=-1))
    cost = jnp.where(reach < 1.5 * spacing, reach * price, 1e3)

    def sweep(_, cost):
        # Each side adds half a step's cost; the padding is too expensive to be the cheapest.
        padded, prices = (jnp.pad(x, 1, constant_values=1e3) for x in (cost, price))
        best = cost
        for i in (-1, 0, 1):
            for j in (-1, 0, 1):
                if i or j:
                    at = (slice(1 + i, _POINTS + 1 + i), slice(1 + j, _POINTS + 1 + j))
                    step = 0.5 * spacing * (i * i + j * j) ** 0.5
                    best = jnp.minimum(best, padded[at] + step * (price + prices[at]))
        return best

    return jax.lax.fori_loop(0, _SWEEPS, sweep, cost)


def waypoint(
    start: Float[Array, "2"],
    target: Float[Array, "2"],
    cost: Float[Array, "G G"],
    obstacles: Obstacles,
    *,
    extent: float,
    near: float = 0.12,
) -> Float[Array, "2"]:
    """The point to head for from `start`: the best grid point 0.2 to 0.4 ahead, or the target.

    The cost is that of `cost_to_go` for the same target, obstacles and extent. A target nearer than
    `near` is headed for whatever is in between.
    """
    grid = _grid(extent)
    length = jnp.sqrt(jnp.sum((grid - start) ** 2, axis=-1))
    price = (_price((grid + start) / 2, obstacles) + _price(grid, obstacles)) / 2
    total = cost + length * price
    total = jnp.where((length < _AHEAD) & (length > 0.5 * _AHEAD), total, 1e4)
    best = grid.reshape(-1, 2)[jnp.argmin(total)]
    straight = jnp.sqrt(jnp.sum((target - start) ** 2) + 1e-12)
    direct = straight * _price((target + start) / 2, obstacles)
    close = (straight < near) | (direct < total.min() + 0.05) & (straight < 2 * _AHEAD)
    return jnp.where(close, target, best)
