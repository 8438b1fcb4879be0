"""The Panda's kinematics against published poses, MuJoCo and finite differences."""

import functools

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


# --- Rotations against MuJoCo's and against each other

RNG = np.random.default_rng(0)
QUATS = RNG.normal(size=(6, 4)).astype(np.float32)
QUATS /= np.linalg.norm(QUATS, axis=1, keepdims=True)


def test_rotations_are_mujocos():
    for quat in QUATS:
        matrix = np.zeros(9)
        mujoco.mju_quat2Mat(matrix, quat.astype(float))
        np.testing.assert_allclose(
            kinematics.rotation(jnp.asarray(quat)), matrix.reshape(3, 3), atol=1e-6
        )


def test_products_are_matrix_products():
    a, b = kinematics.rotation(jnp.asarray(QUATS[:3])), kinematics.rotation(jnp.asarray(QUATS[3:]))
    np.testing.assert_allclose(kinematics.compose(a, b), np.asarray(a) @ np.asarray(b), atol=1e-6)
    vector = RNG.normal(size=(3, 3)).astype(np.float32)
    wanted = np.einsum("bij,bj->bi", a, vector)
    np.testing.assert_allclose(kinematics.turned(a, jnp.asarray(vector)), wanted, atol=1e-6)


def test_into_undoes_out_of():
    place, point = RNG.normal(size=(2, 6, 3)).astype(np.float32)
    frame = kinematics.Frame(jnp.asarray(place), kinematics.rotation(jnp.asarray(QUATS)))
    back = kinematics.into(frame, kinematics.out_of(frame, jnp.asarray(point)))
    np.testing.assert_allclose(back, point, atol=2e-6)


def test_a_small_turn_is_axis_times_sine():
    start = kinematics.rotation(jnp.asarray(QUATS[0]))
    goal = kinematics.compose(kinematics.about_z(jnp.float32(0.2)), start)
    np.testing.assert_allclose(kinematics.small_turn(start, goal), [0, 0, np.sin(0.2)], atol=1e-6)


# --- Effect of actions on the servos' aims

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
