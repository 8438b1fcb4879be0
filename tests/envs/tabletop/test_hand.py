"""A hand driven in C MuJoCo: it goes where it is told, and gives up where it cannot."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.panda import kinematics
from gril_jax.envs.tabletop.moves import CLOSED, Hand

from gril_jax import envs


@pytest.fixture(scope="module")
def scene():
    env = envs.make("shoes_in_box", jitter=0.0)
    return env, jax.jit(env.reset)(jax.random.key(0))


def test_a_move_is_straight_ends_where_it_should_and_takes_its_time(scene):
    hand = Hand(*scene)
    start = hand.place.copy()
    goal = start + [0.0, 0.1, 0.05]
    hand.move(goal, speed=0.2, yaw=0.5)
    steps = hand.steps
    hand.rest(10)
    arms = jnp.array(hand.positions)[:, :7]
    places = np.asarray(jax.jit(jax.vmap(kinematics.tcp))(arms).position)
    np.testing.assert_allclose(hand.place, goal, atol=3e-3)
    np.testing.assert_allclose(places[-1], goal, atol=0.01)
    assert hand.yaw == pytest.approx(0.5, abs=0.06)
    assert steps == pytest.approx(np.linalg.norm(goal - start) / 0.2 * 20, abs=4)
    away = np.cross(places - start, (goal - start) / np.linalg.norm(goal - start))
    assert np.linalg.norm(away, axis=1).max() < 0.012


def test_a_place_out_of_reach_is_given_up(scene):
    hand = Hand(*scene)
    hand.move((0.5, 1.5, 0.3), speed=0.5)
    assert hand.steps < 120
    assert np.isfinite(hand.positions).all()


def test_the_gripper_closes_and_opens_again(scene):
    hand = Hand(*scene)
    hand.close()
    assert hand.grip == CLOSED
    assert hand.qpos[7] < 0.005
    hand.open()
    assert hand.qpos[7] > 0.03
    assert len(hand.positions) == len(hand.velocities) == hand.steps + 1


def test_nothing_happens_beyond_the_limit(scene):
    hand = Hand(*scene, limit=3)
    hand.rest(5)
    hand.move((0.5, 0.2, 0.3), speed=0.1)
    assert hand.steps == 3
