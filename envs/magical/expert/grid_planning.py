"""Shortest paths around round obstacles, on a grid over the arena, inside jit.

The arena is a grid of 25 x 25 points. Going costs its length, and more the deeper it leads into
an obstacle's margin, so that there always is a way, if only a bad one. `cost_to_go` relaxes the
grid as Bellman and Ford do; `waypoint` is where to head from anywhere.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

_POINTS = 25
_SWEEPS = 44  # a way over more points than this is not found; the arena's side has 25
_REACH = 0.4  # how far a point to head for is, at most
_PENALTY = 12.0  # times dearer at an obstacle's centre than in the open


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
        # Half a step is paid on either side; the border is padded with what never is cheapest.
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
    total = jnp.where((length < _REACH) & (length > 0.5 * _REACH), total, 1e4)
    best = grid.reshape(-1, 2)[jnp.argmin(total)]
    straight = jnp.sqrt(jnp.sum((target - start) ** 2) + 1e-12)
    direct = straight * _price((target + start) / 2, obstacles)
    close = (straight < near) | (direct < total.min() + 0.05) & (straight < 2 * _REACH)
    return jnp.where(close, target, best)
