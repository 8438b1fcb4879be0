"""The Panda's kinematics against published poses, MuJoCo and finite differences."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from gril_jax.envs.panda import kinematics
from gril_jax.envs.panda import model as panda_model
from gril_jax.envs.panda.kinematics import Frame
from gril_jax.envs.tabletop.boxes import box
from gril_jax.envs.tabletop.physics import Additions, build

PI = np.pi
POSES = [  # joints; tool centre point; where the fingers open
    ((0,) * 7, (0.0880, 0, 0.8226), (0.7071, -0.7071, 0)),
    ((0, 0, 0, -1.57079, 0, 1.57079, -0.7853), (0.5545, 0, 0.5211), (1, 0, 0)),
    ((0, 0.3, 0, -1.57079, 0, 2.0, -0.7853), (0.6778, 0, 0.3785), (0.9917, 0, 0.1289)),
    ((0, PI / 8, 0, -5 * PI / 8, 0, 3 * PI / 4, PI / 4), (0.6150, 0, 0.1698), (0, -1, 0)),
    (tuple(np.deg2rad([0, 10, 0, -50, 0, 70, 45])), (0.5506, 0, 0.7014), (0, -1, 0)),
]
REST = np.array(POSES[3][0], np.float32)


@pytest.fixture(scope="module")
def arm():
    """The arm alone, in C MuJoCo."""
    return build(Additions("", ()), timestep=0.005, iterations=4, ls_iterations=6, max_contacts=4)


def _random(count, seed=0):
    low, high = kinematics.JOINT_RANGE.T
    return np.random.default_rng(seed).uniform(low, high, (count, 7)).astype(np.float32)


@pytest.mark.parametrize(("q", "place", "opens"), POSES)
def test_the_tool_is_where_published_poses_have_it(q, place, opens):
    found = kinematics.tcp(jnp.array(q, jnp.float32))
    np.testing.assert_allclose(found.position, place, atol=1e-4)
    np.testing.assert_allclose(found.rotation[:, 1], opens, atol=1e-3)


def test_hand_and_pads_are_where_mujoco_has_them(arm):
    data = mujoco.MjData(arm)
    for q in _random(5):
        data.qpos[:] = [*q, 0.03, 0.01]
        mujoco.mj_kinematics(arm, data)
        hand = kinematics.hand(jnp.asarray(q))
        np.testing.assert_allclose(hand.position, data.body("hand").xpos, atol=2e-6)
        rotation = data.body("hand").xmat.reshape(3, 3)
        np.testing.assert_allclose(hand.rotation, rotation, atol=2e-6)
        pads = zip(panda_model.PADS, (1, -1), (0.03, 0.01), strict=True)
        for name, side, opening in pads:
            frame = kinematics.finger(hand, jnp.float32(opening), side)
            pad = box(frame, panda_model.PAD_CENTER, panda_model.PAD_HALF)
            np.testing.assert_allclose(pad.position, data.geom(name).xpos, atol=2e-6)
            np.testing.assert_allclose(pad.rotation, data.geom(name).xmat.reshape(3, 3), atol=2e-6)


def test_the_jacobian_is_mujocos(arm):
    data, rows = mujoco.MjData(arm), np.zeros((2, 3, arm.nv))
    q = _random(1)[0]
    data.qpos[:7] = q
    mujoco.mj_kinematics(arm, data)
    mujoco.mj_comPos(arm, data)
    found, point = kinematics.jacobian(jnp.asarray(q))
    mujoco.mj_jac(arm, data, *rows, np.asarray(point.position, float), arm.body("hand").id)
    np.testing.assert_allclose(found, rows[:, :, :7].reshape(6, 7), atol=1e-5)


def test_reach_arrives_and_leaves_the_hand_where_it_is():
    reach = jax.jit(lambda q, g: kinematics.reach(q, g, rest=jnp.asarray(REST)))
    q = jnp.asarray(REST)
    start = kinematics.tcp(q)
    goal = start._replace(position=start.position + jnp.array([0.02, 0.01, 0.015]))
    found = kinematics.tcp(reach(q, goal))
    np.testing.assert_allclose(found.position, goal.position, atol=5e-4)
    np.testing.assert_allclose(found.rotation, goal.rotation, atol=2e-3)
    moved = kinematics.tcp(reach(q + 0.1, kinematics.tcp(q + 0.1)))
    np.testing.assert_allclose(moved.position, kinematics.tcp(q + 0.1).position, atol=5e-4)


def test_a_goal_out_of_reach_keeps_joints_in_range_and_finite():
    goal = Frame(jnp.array([3.0, 0.0, 3.0]), jnp.eye(3))
    rest = found = jnp.asarray(REST)
    for _ in range(2):
        found = kinematics.reach(found, goal, rest=rest)
    low, high = kinematics.JOINT_RANGE.astype(np.float32).T
    assert np.isfinite(found).all()
    assert ((found >= low) & (found <= high)).all()
