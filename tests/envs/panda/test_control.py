"""Effect of actions on the servos' aims."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.panda import kinematics

HOME = np.array([0.0571, -0.1029, 0.0417, -2.2644, 0.0052, 2.1616, 0.8812], np.float32)
TARGET = np.array([*HOME, 0.04], np.float32)


@functools.cache
def _aim():
    return jax.jit(functools.partial(kinematics.aim, rest=jnp.asarray(HOME), dt=0.05))


def _tool(target):
    return kinematics.tcp(jnp.asarray(target)[:7])


def test_rest_holds_the_hand_for_a_whole_episode():
    action = np.zeros(len(kinematics.ACTION_NAMES), np.float32)
    target = TARGET
    for _ in range(100):
        target = _aim()(target, target[:7], action)
    np.testing.assert_allclose(_tool(target).position, _tool(TARGET).position, atol=2e-3)


def test_the_tool_moves_along_the_worlds_axes():
    action = np.zeros(len(kinematics.ACTION_NAMES), np.float32)
    action[:3] = [0.8, -0.4, 0.4]
    found = _tool(_aim()(TARGET, HOME, action))
    move = np.asarray(found.position - _tool(TARGET).position)
    np.testing.assert_allclose(move, 0.025 * action[:3], atol=5e-4)
    np.testing.assert_allclose(found.rotation[:, 2], [0, 0, -1], atol=5e-3)


def test_yaw_turns_the_hand_about_the_vertical():
    action = np.zeros(len(kinematics.ACTION_NAMES), np.float32)
    action[3] = 1.0
    found = _tool(_aim()(TARGET, HOME, action))
    forward = np.asarray(found.rotation[:, 0] @ _tool(TARGET).rotation)
    assert np.arctan2(found.rotation[1, 0], found.rotation[0, 0]) == pytest.approx(0.1, abs=5e-3)
    assert forward[0] == pytest.approx(np.cos(0.1), abs=1e-3)


def test_a_tilted_hand_is_brought_upright_by_the_yaw_controller():
    tilted = TARGET + np.array([0, 0.1, 0, 0, 0, 0.1, 0, 0], np.float32)
    target = tilted
    for _ in range(5):
        target = _aim()(target, target[:7], np.zeros(5, np.float32))
    np.testing.assert_allclose(_tool(target).rotation[:, 2], [0, 0, -1], atol=2e-3)


def test_aims_keep_to_speeds_ranges_and_near_a_blocked_arm():
    rng = np.random.default_rng(0)
    target = TARGET
    low, high = kinematics.JOINT_RANGE.astype(np.float32).T
    for _ in range(50):
        action = np.sign(rng.uniform(-1, 1, len(kinematics.ACTION_NAMES)))
        after = np.asarray(_aim()(target, HOME, action.astype(np.float32)))
        assert (np.abs(after - target)[:7] <= 0.05 * kinematics.JOINT_SPEED + 1e-5).all()
        assert (np.abs(after[:7] - HOME) <= 0.3 + 1e-5).all()
        assert ((after[:7] >= low) & (after[:7] <= high)).all()
        target = after


def test_the_gripper_opens_at_one_and_presses_at_minus_one():
    for a, opening in ((-1, -0.01), (0, 0.015), (1, 0.04)):
        action = np.array([0] * 4 + [a], np.float32)
        assert _aim()(TARGET, HOME, action)[7] == pytest.approx(opening, abs=1e-6)
