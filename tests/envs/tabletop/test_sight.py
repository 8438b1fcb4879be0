"""Stages as seen: a thing on a rail, against the nearest of many points."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.tabletop import placing

WAY = np.array([(0.0, 0.0), (0.4, 0.3), (0.9, 0.3)])
ASIDE = (0.05, 0.1)
CENTER, SIZE = jnp.array([[0.2, -0.1], [0.0, 0.0]]), jnp.array([[0.5, 0.4], [0.1, 0.1]])


def _nearest(place):
    """The way's nearest point to a place, of many."""
    pairs = itertools.pairwise(WAY)
    points = np.concatenate([a + np.linspace(0, 1, 2001)[:, None] * (b - a) for a, b in pairs])
    return points[np.argmin(np.linalg.norm(points - place, axis=1))]


@pytest.mark.parametrize("seed", range(8))
def test_what_has_left_its_rail_is_put_back_beside_its_nearest_point(seed):
    place = np.random.default_rng(seed).uniform(-0.5, 1.2, 2)
    possible = jax.jit(placing.on_rail(1, 0, WAY, ASIDE))
    center = CENTER.at[1].set(CENTER[0] + place * SIZE[0])
    found = (possible(center, SIZE)[1] - CENTER[0]) / SIZE[0]
    near = _nearest(place)
    np.testing.assert_allclose(
        found, near + np.clip(place - near, -np.array(ASIDE), ASIDE), atol=1e-3
    )
    np.testing.assert_array_equal(possible(center, SIZE)[0], CENTER[0])


def test_what_is_on_it_stays_there():
    center = CENTER.at[1].set(CENTER[0] + jnp.array([0.21, 0.15]) * SIZE[0])
    possible = placing.on_rail(1, 0, WAY, ASIDE)
    np.testing.assert_allclose(possible(center, SIZE), center, atol=1e-6)
