"""Starts: what overlaps, what is drawn, and what cannot be placed."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.tabletop import placing
from gril_jax.envs.tabletop import start as starts
from gril_jax.envs.tabletop.start import Footprint


def _thing(x, y, yaw, half=(0.08, 0.03)):
    return Footprint(jnp.array([x, y, yaw], jnp.float32), jnp.array(half, jnp.float32))


def _distance(a, b):
    """Least distance of two rectangles by points along their edges; 0 if a corner is inside."""

    def points(thing):
        t = np.linspace(-1, 1, 81)
        edge = np.concatenate([np.stack([t, s * np.ones(81)], 1) for s in (-1, 1)])
        edge = np.concatenate([edge, edge[:, ::-1]]) * np.asarray(thing.half)
        c, s = np.cos(thing.place[2]), np.sin(thing.place[2])
        return edge @ np.array([[c, s], [-s, c]]) + np.asarray(thing.place[:2])

    return np.linalg.norm(points(a)[:, None] - points(b), axis=2).min()


def test_things_are_apart_only_with_a_gap_of_a_centimetre():
    rng = np.random.default_rng(0)
    apart = jax.jit(starts.apart)
    seen = set()
    for _ in range(60):
        a, b = (_thing(*rng.uniform(-0.1, 0.1, 2), rng.uniform(-3, 3)) for _ in range(2))
        found, distance = bool(apart(a, b)), _distance(a, b)
        seen.add(found)
        if found:  # corner to corner, the separating axis asks for a little more
            assert distance >= 0.0099
        elif distance > 0.0145:  # then one lies within the other's outline
            assert np.linalg.norm(a.place[:2] - b.place[:2]) < 0.06
    assert seen == {True, False}


def test_a_group_moves_as_one_within_its_ranges():
    layout = jnp.array([[0.5, -0.15, 0.0], [0.48, 0.14, 0.2]])
    keys = jax.random.split(jax.random.key(0), 200)
    found = np.asarray(jax.jit(jax.vmap(lambda k: starts.group(k, layout, share=1.0)))(keys))
    gap = np.linalg.norm(found[:, 0, :2] - found[:, 1, :2], axis=1)
    np.testing.assert_allclose(gap, np.linalg.norm(layout[0, :2] - layout[1, :2]), atol=1e-6)
    turn = found[:, 0, 2]
    np.testing.assert_allclose(found[:, 1, 2] - turn, 0.2, atol=1e-6)
    assert 0.35 < np.abs(turn).max() <= 0.3928
    np.testing.assert_allclose(starts.group(keys[0], layout, share=0.0), layout, atol=1e-6)


def test_things_are_placed_apart_or_said_not_to_be():
    half = jnp.full((2, 2), jnp.array([0.08, 0.03]))
    standing = Footprint(jnp.array([[0.0, -0.2, 0.0]]), jnp.array([[0.1, 0.1]]))

    def draw(key, spread):
        layout = jnp.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]) * spread
        layout += jnp.array([0.0, -0.05, 0.0])
        things = Footprint(layout, half)
        places, unplaced = starts.place(key, things, standing, share=1.0)
        return Footprint(places, half), unplaced

    keys = jax.random.split(jax.random.key(1), 50)
    many = jax.jit(jax.vmap(draw, (0, None)))
    found, unplaced = many(keys, 0.1)
    pick = lambda i: jax.tree.map(lambda x: x[:, i], found)  # noqa: E731
    assert not unplaced.any()
    assert jax.jit(jax.vmap(starts.apart))(pick(0), pick(1)).all()
    _, unplaced = many(keys, 0.0)
    assert unplaced.all()


def test_free_joints_stand_level():
    found = starts.free_joint(jnp.array([[0.1, 0.2, 0.6], [0.3, 0.4, 0.0]]), 0.05).reshape(2, 7)
    np.testing.assert_allclose(
        found[0], [0.1, 0.2, 0.05, np.cos(0.3), 0, 0, np.sin(0.3)], rtol=1e-6
    )
    np.testing.assert_allclose(found[1], [0.3, 0.4, 0.05, 1, 0, 0, 0], rtol=1e-6)


# --- Stages as seen: a thing on a rail, against the nearest of many points

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
