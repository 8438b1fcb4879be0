"""The compiled scene: masses, friction, pairs, and the inertia that the drive counts on."""

import math
from collections import Counter

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from gril_jax.envs import planar_model, shapes

from gril_jax import envs

SURFACE = {"robot": 0.5, "left_finger": 5.0, "right_finger": 5.0}  # blocks: 0.5


@pytest.fixture(scope="module")
def env():
    return envs.make("match_regions")


@pytest.fixture(scope="module")
def model(env):
    return env.mj_model


def _body(model, geom):
    return model.body(model.geom_bodyid[geom]).name


def _pairs(model):
    """(body, body, friction) of every contact pair."""
    return [
        (_body(model, a), _body(model, b), mu[0])
        for a, b, mu in zip(model.pair_geom1, model.pair_geom2, model.pair_friction, strict=True)
    ]


def _poses(model, count, seed=0):
    rng = np.random.default_rng(seed)
    qpos = rng.uniform(-1, 1, (count, model.nq))
    qpos[:, 2] *= math.pi
    qpos[:, 3] = rng.uniform(0, planar_model.FINGER_OPEN, count)
    qpos[:, 4] = rng.uniform(-planar_model.FINGER_OPEN, 0, count)
    return qpos


def test_size_of_the_model_is_pinned(model):
    """Speed depends on these: whoever changes one should measure the other."""
    assert (model.nq, model.nv, model.nu) == (20, 20, 0)
    assert (model.ngeom, model.npair) == (25, 254)


def test_joint_positions_are_the_poses(model):
    data = mujoco.MjData(model)
    data.qpos[:] = _poses(model, 1)[0]
    mujoco.mj_forward(model, data)
    names = ["robot", *(f"block_{i}" for i in range(5))]
    starts = [0, *range(5, 20, 3)]
    for name, i in zip(names, starts, strict=True):
        x, y, angle = data.qpos[i : i + 3]
        np.testing.assert_allclose(data.body(name).xpos, [x, y, 0], atol=1e-12)
        np.testing.assert_allclose(data.body(name).xipos, [x, y, 0], atol=1e-12)
        turned = data.body(name).xmat.reshape(3, 3)[:2, :2]
        c, s = math.cos(angle), math.sin(angle)
        np.testing.assert_allclose(turned, [[c, -s], [s, c]], atol=1e-12)


def test_friction_of_each_pair_is_the_product_of_both_surfaces(model):
    for first, second, mu in _pairs(model):
        expected = SURFACE.get(first, 0.5) * SURFACE.get(second, 0.5)
        assert mu == pytest.approx(expected), (first, second)
    np.testing.assert_array_equal(model.pair_friction[:, 0], model.pair_friction[:, 1])
    found = {mu for *_, mu in _pairs(model)}
    assert found == {0.25, 2.5}  # body or block on block, finger on block


def test_every_two_bodies_touch_in_all_their_parts_but_the_robots_own_never(model):
    parts = Counter(_body(model, g) for g in range(model.ngeom))
    bodies = sorted(parts)
    counted = Counter(tuple(sorted(pair[:2])) for pair in _pairs(model))
    for i, a in enumerate(bodies):
        for b in bodies[i + 1 :]:
            own = a in SURFACE and b in SURFACE
            assert counted[a, b] == (0 if own else parts[a] * parts[b]), (a, b)
    assert not model.geom_contype.any()
    assert not model.geom_conaffinity.any()


def test_closed_fingers_through_the_disc_make_no_contact(model):
    data = mujoco.MjData(model)
    data.qpos[5:] = np.linspace(-1, 1, 15)
    data.qpos[[5, 8, 11, 14, 17]] = [-0.9, 0.9, -0.9, 0.9, 0.9]
    data.qpos[[6, 9, 12, 15, 18]] = [-0.9, 0.9, 0.9, -0.9, 0.0]
    mujoco.mj_forward(model, data)
    assert data.ncon == 0


def test_masses_and_table_friction_are_the_references(model):
    mass = {model.body(i).name: model.body_mass[i] for i in range(1, model.nbody)}
    assert mass == {
        "robot": 1.0,
        "left_finger": 0.125,
        "right_finger": 0.125,
        **{f"block_{i}": 0.01 for i in range(5)},
    }
    np.testing.assert_array_equal(model.dof_frictionloss[:5], 0.0)
    np.testing.assert_array_equal(model.dof_frictionloss[5:].reshape(5, 3), [[1.5, 1.5, 0.1]] * 5)
    inertia = [model.body(f"block_{i}").inertia[2] for i in range(5)]
    np.testing.assert_allclose(inertia, [9.365e-5, 7.54e-5, 7.322e-5, 7.2e-5, 7.322e-5])


def test_inertia_of_a_finger_about_its_pivot_is_the_references(model):
    for side in ("left", "right"):
        body = model.body(f"{side}_finger")
        about_pivot = body.inertia[2] + body.mass[0] * (body.ipos[:2] @ body.ipos[:2])
        assert about_pivot == pytest.approx(0.005)


def test_fingers_are_limited_from_closed_to_open(model):
    low, high = model.joint("left_finger").range
    assert (low, high) == pytest.approx((0.0, math.pi / 8))
    assert tuple(model.joint("right_finger").range) == pytest.approx((-math.pi / 8, 0.0))


@pytest.mark.parametrize(("angle", "gap"), [(0.0, 0.03), (math.pi / 8, 0.29)])
def test_tips_are_as_far_apart_as_in_the_reference(angle, gap):
    """Inner corner to inner corner: closed 0.03, open 0.29."""
    inner = []
    for side, turn in ((-1, angle), (1, -angle)):
        far = shapes.finger(side).vertices[2:4]  # both corners of the tip
        x, y = far[np.argmax(-side * far[:, 0])]
        inner.append(side * planar_model.PIVOT[0] + x * math.cos(turn) - y * math.sin(turn))
    assert inner[1] - inner[0] == pytest.approx(gap, abs=0.012)


@pytest.mark.parametrize("substeps", [5, 10])
def test_inertia_of_the_drive_is_mujocos(substeps):
    env = envs.make("match_regions", substeps=substeps)
    model = env.mj_model
    data, column = mujoco.MjData(model), np.zeros(model.nv)
    poses = _poses(model, 20)
    ours = np.asarray(jax.vmap(env._robot_mass)(jnp.asarray(poses, jnp.float32)))
    for qpos, mass in zip(poses, ours, strict=True):
        data.qpos[:] = qpos
        mujoco.mj_forward(model, data)
        for joint, expected in enumerate(mass.T):
            mujoco.mj_mulM(model, data, column, np.eye(model.nv)[joint])
            np.testing.assert_allclose(column[:5], expected, atol=2e-6)
            np.testing.assert_array_equal(column[5:], 0.0)  # blocks are no part of the robot
    rotor = planar_model.finger_armature(env.dt)
    assert ours[0, 3, 3] == pytest.approx(0.005 + rotor, rel=1e-5)  # 0.005: about the pivot


def test_a_blocked_finger_motor_grips_with_its_full_torque():
    """Rate 1 rad/s, reached in one substep from rest, must take 4."""
    for timestep in (0.025, 0.0125):
        armature = planar_model.finger_armature(timestep)
        assert armature * planar_model.FINGER_RATE / timestep == planar_model.FINGER_TORQUE


def test_a_robot_without_fingers_has_three_joints():
    stick = planar_model.RobotShape(shapes.stadium(0.6, 0.1, 0.03083), 1.0, False)
    blocks = [shapes.block("circle"), shapes.block("star")]
    model = planar_model.build(stick, blocks, timestep=0.01, iterations=1, max_contacts=4)
    assert model.nv == 3 + 6
    assert model.npair == 1 * (1 + 5) + 5
    assert model.opt.timestep == 0.01
    assert model.body("robot").mass[0] == 1.0
