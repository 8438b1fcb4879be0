"""Ways around obstacles: straight where nothing is, around what is, through what does not count."""

import chex
import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.magical.match_regions.expert.ways import Obstacles, cost_to_go, waypoint

EXTENT = 1.0


def _obstacles(*discs):
    discs = np.asarray(discs, np.float32).reshape(-1, 3)
    return Obstacles(jnp.asarray(discs[:, :2]), jnp.asarray(discs[:, 2]), jnp.float32(0.95))


@jax.jit
def _plan(target, obstacles):
    return cost_to_go(target, obstacles, extent=EXTENT)


@jax.jit
def _head(at, target, cost, obstacles):
    return waypoint(at, target, cost, obstacles, extent=EXTENT)


def _walk(start, target, obstacles, steps=60):
    """The broken line of a point that heads for its way point, 0.05 at a time."""
    target = jnp.asarray(target, jnp.float32)
    cost = _plan(target, obstacles)
    path = [np.asarray(start, np.float32)]
    for _ in range(steps):
        away = np.asarray(_head(path[-1], target, cost, obstacles)) - path[-1]
        share = min(1.0, 0.05 / max(np.linalg.norm(away), 1e-6))
        path.append(np.float32(path[-1] + away * share))
    return np.stack(path)


def test_cost_in_the_open_is_the_distance_along_a_grid_with_diagonals():
    cost = np.asarray(_plan(jnp.zeros(2), _obstacles((0.9, 0.9, 0.0))))
    axis = np.linspace(-EXTENT, EXTENT, len(cost))
    near, far = (f(np.abs(axis[:, None]), np.abs(axis)) for f in (np.minimum, np.maximum))
    inner = far < 0.9  # the wall costs beyond
    octile = far + (np.sqrt(2) - 1) * near
    np.testing.assert_allclose(cost[inner], octile[inner], atol=0.02)


def test_a_free_way_is_straight():
    path = _walk((-0.8, 0.0), (0.8, 0.0), _obstacles((0.0, 0.8, 0.3)))
    assert np.abs(path[:, 1]).max() < 0.15
    np.testing.assert_allclose(path[-1], [0.8, 0.0], atol=0.03)


def test_an_obstacle_on_the_way_is_passed_on_the_shorter_side():
    path = _walk((-0.8, 0.0), (0.8, 0.0), _obstacles((0.0, 0.1, 0.45)))
    apart = np.linalg.norm(path - np.array([0.0, 0.1]), axis=1)
    assert apart.min() > 0.3
    assert path[np.argmin(apart), 1] < 0
    np.testing.assert_allclose(path[-1], [0.8, 0.0], atol=0.03)


def test_an_obstacle_of_radius_zero_does_not_count():
    free = _walk((-0.8, 0.0), (0.8, 0.0), _obstacles((0.0, 0.8, 0.0)))
    through = _walk((-0.8, 0.0), (0.8, 0.0), _obstacles((0.0, 0.0, 0.0)))
    np.testing.assert_allclose(free, through, atol=1e-6)


def test_a_target_inside_an_obstacle_is_still_reached():
    path = _walk((-0.8, 0.0), (0.5, 0.0), _obstacles((0.5, 0.0, 0.4)))
    np.testing.assert_allclose(path[-1], [0.5, 0.0], atol=0.03)


def test_finite_anywhere_and_vmap_is_a_loop():
    starts = jnp.asarray([(0.3, -0.4), (-2.0, 3.0), (0.0, 0.0)], jnp.float32)
    obstacles = _obstacles((0.3, -0.4, 0.5), (0.3, -0.4, 0.5))
    target = jnp.zeros(2)

    @jax.jit
    def head(at):
        cost = cost_to_go(target, obstacles, extent=EXTENT)
        return waypoint(at, target, cost, obstacles, extent=EXTENT)

    together = jax.vmap(head)(starts)
    chex.assert_tree_all_finite(together)
    chex.assert_trees_all_close(together, jnp.stack([head(s) for s in starts]), atol=1e-6)
