"""Masses, inertias and servos of the Panda's model, in C MuJoCo."""

import mujoco
import numpy as np
import pytest
from gril_jax.envs.panda import kinematics
from gril_jax.envs.panda import model as panda_model
from gril_jax.envs.tabletop.physics import Additions, build

HOME = [0.0571, -0.1029, 0.0417, -2.2644, 0.0052, 2.1616, 0.8812]


@pytest.fixture(scope="module")
def arm():
    return build(Additions("", ()), timestep=0.005, iterations=4, ls_iterations=6, max_contacts=4)


def test_masses_are_the_published_ones(arm):
    links = [arm.body(f"link{i}").mass[0] for i in range(8)]
    assert sum(links) == pytest.approx(16.6915, abs=1e-3)
    assert arm.body("hand").mass[0] == 0.73
    assert arm.body("left_finger").mass[0] == arm.body("right_finger").mass[0] == 0.015


def test_inertias_are_those_of_bodies_that_can_exist(arm):
    principal = np.sort(arm.body_inertia[1:], axis=1)
    assert (principal > 0).all()
    assert (principal[:, 0] + principal[:, 1] >= principal[:, 2] - 1e-9).all()


def test_joints_are_nine_in_order_with_ranges_in_radians(arm):
    assert arm.nv == panda_model.DOFS
    names = [arm.joint(i).name for i in range(arm.njnt)]
    assert names == [*(f"joint{i}" for i in range(1, 8)), "left_finger", "right_finger"]
    np.testing.assert_allclose(arm.jnt_range[:7], kinematics.JOINT_RANGE, atol=1e-9)


def _play(arm, ctrl, seconds):
    data = mujoco.MjData(arm)
    data.qpos[:] = [*HOME, 0.04, 0.04]
    data.ctrl[:] = ctrl
    for _ in range(round(seconds / 0.005)):
        mujoco.mj_step(arm, data)
    return data


def test_servos_hold_the_arm_still_against_its_weight(arm):
    data = _play(arm, [*HOME, 0.04], 1.0)
    np.testing.assert_allclose(data.qpos[:7], HOME, atol=2e-3)


def test_one_servo_closes_both_fingers(arm):
    data = _play(arm, [*HOME, 0.01], 1.0)
    np.testing.assert_allclose(data.qpos[7:9], 0.01, atol=1e-3)


def test_a_tip_ends_where_its_pad_does(arm):
    data = _play(arm, [*HOME, 0.04], 0.005)
    for pad, tip in zip(panda_model.PADS, panda_model.TIPS, strict=True):
        down = data.body("hand").xmat.reshape(3, 3)[:, 2]
        pad_end = down @ data.geom(pad).xpos + arm.geom(pad).size[2]
        tip_end = down @ data.geom(tip).xpos + arm.geom(tip).size[0]
        assert pad_end == pytest.approx(tip_end, abs=1e-6)
