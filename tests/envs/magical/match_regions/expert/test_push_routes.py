"""Routes of a stick: it arrives at waypoints either way round; drawn pushes lead to the place."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.magical.match_regions.expert import push_routes as routes

from gril_jax import envs


@pytest.fixture(scope="module")
def env():
    blocks = {"targets": ("green square",), "distractors": ()}
    return envs.make("match_regions", robot="short", **blocks)


@pytest.fixture(scope="module")
def drive(env):
    """From two poses of the robot along waypoints: its poses and routes, of 40 control steps."""

    def roll(start, points):
        pose = jnp.stack([start, jnp.array([-0.9, 0.9, 0.0])])
        state = env.reset_to(pose, jnp.zeros((2, 3)))
        zero = jnp.zeros((), jnp.int32)

        def move(carry, _):
            state, route = carry
            action, route = routes.follow(env, route, state)
            state = env.step(state, action)
            return (state, route), (state.data.pose[0], route, action)

        begin = state, routes.Route(points, zero, zero)
        return jax.lax.scan(move, begin, length=40)[1]

    return jax.jit(jax.vmap(roll))


POINTS = np.array([[0.4, -0.3], [0.6, -0.3], [0.6, 0.2]], np.float32)


def test_a_stick_arrives_at_each_waypoint_in_turn(drive):
    pose, route, action = drive(jnp.zeros((2, 3)), jnp.asarray(np.stack([POINTS, POINTS])))
    pose, at = np.asarray(pose[0]), np.asarray(route.at[0])
    for point in POINTS:
        assert np.linalg.norm(pose[:, :2] - point, axis=1).min() < 0.09
    assert (np.diff(at) >= 0).all()
    assert at[-1] == 3
    np.testing.assert_array_equal(np.asarray(action[0])[at == 3], 0.0)


def test_either_long_side_leads_and_both_drive_the_same_way(drive):
    """A stick looks the same turned by half a circle, and then drives backwards."""
    starts = jnp.array([[0.0, 0.0, 0.4], [0.0, 0.0, 0.4 + np.pi]])
    pose, _, action = drive(starts, jnp.asarray(np.stack([POINTS, POINTS])))
    np.testing.assert_allclose(pose[0, :, :2], pose[1, :, :2], atol=5e-3)
    np.testing.assert_allclose(action[0, :10, 0], -action[1, :10, 0], atol=1e-2)
    assert np.abs(np.asarray(pose[0, :6, 2]) - 0.4).max() < 0.7  # forward would be 2.6 away


def test_a_waypoint_out_of_reach_is_given_up(drive):
    points = np.array([[2.0, 0.0], [0.5, 0.0], [0.5, 0.0]], np.float32)
    _, route, _ = drive(jnp.zeros((2, 3)), jnp.asarray(np.stack([points, points])))
    assert np.asarray(route.at[0])[-1] > 0


def test_standing_still_is_a_route_that_is_over(env):
    state = jax.jit(env.reset)(jax.random.key(0))
    action, route = jax.jit(lambda state: routes.follow(env, routes.stay(), state))(state)
    np.testing.assert_array_equal(action, 0.0)
    assert route.at == 3


@pytest.fixture(scope="module")
def draw(env):
    return jax.jit(jax.vmap(lambda *given: routes.draw(env, *given), (0, None, None, None)))


def test_drawn_routes_stay_in_the_arena_and_most_push_towards_the_place(env, draw):
    block, slot = jnp.array([0.3, 0.3]), jnp.array([-0.4, 0.1])
    keys = jax.random.split(jax.random.key(0), 500)
    drawn = draw(keys, jnp.array([0.0, -0.5]), block, slot)
    points = np.asarray(drawn.points)
    assert np.abs(points).max() <= env.arena - 0.06 + 1e-6
    assert (np.asarray(drawn.at) == 0).all()
    push = points[:, 2] - points[:, 1]
    push /= np.linalg.norm(push, axis=1, keepdims=True)
    way = np.asarray(slot - block) / np.linalg.norm(slot - block)
    assert 0.5 < (push @ way > 0.8).mean() < 0.95  # some push it another way, off a wall
    behind = np.asarray(block) - points[:, 1]
    assert 0.2 < np.linalg.norm(behind, axis=1).mean() < 0.5


def test_a_block_at_its_place_gives_finite_routes(draw):
    point = jnp.zeros(2)
    drawn = draw(jax.random.split(jax.random.key(0), 500), point, point, point)
    assert np.isfinite(np.asarray(drawn.points)).all()
