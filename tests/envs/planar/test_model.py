"""The compiled scene of the MJX engine: masses, friction, pairs, limits, coordinates."""

import math
from collections import Counter

import mujoco
import numpy as np
import pytest
from gril_jax.envs.planar import model as planar_model
from gril_jax.envs.planar import robots, shapes
from support.planar_scenes import signed_distance

SHAPES = ("star", "square", "pentagon", "circle", "pentagon")
SURFACE = {"robot": 0.5, "left_finger": 5.0, "right_finger": 5.0}  # blocks: 0.5
OPEN = math.pi / 8


@pytest.fixture(scope="module")
def model():
    return planar_model.build(SHAPES, timestep=0.025, iterations=2)


def _body(model, geom):
    return model.body(model.geom_bodyid[geom]).name


def _pairs(model):
    """(body, body, friction) of every contact pair."""
    return [
        (_body(model, a), _body(model, b), mu[0])
        for a, b, mu in zip(model.pair_geom1, model.pair_geom2, model.pair_friction, strict=True)
    ]


def test_size_of_the_model_is_pinned(model):
    """Speed depends on these: whoever changes one should measure the other."""
    assert (model.nq, model.nv, model.nu) == (20, 20, 0)
    assert (model.ngeom, model.npair) == (25, 254)


def test_joint_positions_are_the_poses(model):
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    data.qpos[:] = rng.uniform(-1, 1, model.nq)
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
    data.qpos[[5, 8, 11, 14, 17]] = [-0.9, 0.9, -0.9, 0.9, 0.9]
    data.qpos[[6, 9, 12, 15, 18]] = [-0.9, 0.9, 0.9, -0.9, 0.0]
    mujoco.mj_forward(model, data)
    assert data.ncon == 0


def test_a_block_in_the_fingers_way_makes_contact(model):
    data = mujoco.MjData(model)
    data.qpos[[5, 8, 11, 14, 17]] = [-0.9, 0.9, -0.9, 0.9, 0.09]
    data.qpos[[6, 9, 12, 15, 18]] = [-0.9, 0.9, 0.9, -0.9, 0.34]
    mujoco.mj_forward(model, data)
    touched = {_body(model, g) for pair in data.contact.geom[: data.ncon] for g in pair}
    assert {"right_finger", "block_4"} <= touched


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
    expected = [9.365e-5, 7.54e-5, 7.322e-5, 7.2e-5, 7.322e-5]
    np.testing.assert_allclose(inertia, expected, rtol=1e-4)
    assert model.body("robot").inertia[2] == pytest.approx(0.020)


def test_a_fingers_centre_of_mass_is_its_pivot(model):
    for side, name in ((-1, "left_finger"), (1, "right_finger")):
        body = model.body(name)
        np.testing.assert_array_equal(body.ipos, 0.0)
        np.testing.assert_allclose(body.pos, [side * 0.09, 0.02, 0.0])
        assert body.inertia[2] == pytest.approx(0.005, rel=4e-3)


def test_fingers_are_limited_from_closed_to_open(model):
    assert tuple(model.joint("left_finger").range) == pytest.approx((0.0, OPEN))
    assert tuple(model.joint("right_finger").range) == pytest.approx((-OPEN, 0.0))


@pytest.mark.parametrize(("angle", "gap"), [(0.0, 0.03), (OPEN, 0.29)])
def test_tips_are_as_far_apart_as_in_the_reference(model, angle, gap):
    """Forearm to forearm at the wrists' capsules: closed about 0.03, open about 0.29."""
    data = mujoco.MjData(model)
    data.qpos[3:5] = angle, -angle
    mujoco.mj_forward(model, data)
    ends = []
    for name in ("left_finger_1", "right_finger_1"):
        geom = data.geom(name)
        along, half = geom.xmat.reshape(3, 3)[:2, 2], model.geom(name).size[1]
        tips = geom.xpos[:2] + half * np.array([[1], [-1]]) * along
        ends.append(tips[np.argmax(tips[:, 1])])
    assert np.linalg.norm(ends[1] - ends[0]) - 0.05 == pytest.approx(gap, abs=0.025)


def test_a_blocked_finger_motor_grips_with_its_full_torque():
    """Rate 1 rad/s, reached in one substep from rest, must take 4."""
    for timestep in (0.025, 0.0125):
        assert planar_model.finger_armature(timestep) * 1.0 / timestep == pytest.approx(4.0)


def test_the_model_takes_the_options_it_is_given():
    model = planar_model.build(("circle", "star"), timestep=0.01, iterations=3)
    assert model.nv == 5 + 6
    assert model.npair == 5 * (1 + 5) + 5
    assert (model.opt.timestep, model.opt.iterations) == (0.01, 3)
    assert model.numeric("max_contact_points").data[0] == 16


# --- The capsules against the outlines that they stand for

_, *FINGERS = robots.robot("gripper").parts


def _rim(capsule, count=64):
    """Points on the boundary of one capsule."""
    start, end, radius = np.array(capsule.start), np.array(capsule.end), capsule.radius
    angles = 2 * math.pi * np.arange(count) / count
    ring = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    if np.allclose(start, end):
        return start + ring
    along = (end - start) / np.linalg.norm(end - start)
    ends = [start + ring[ring @ along <= 0], end + ring[ring @ along >= 0]]
    across = radius * np.array([-along[1], along[0]])
    sides = [start + (end - start) * t + s * across for t in np.linspace(0, 1, 9) for s in (-1, 1)]
    return np.concatenate([*ends, np.array(sides)])


def _covered(points, capsules):
    """True for points that lie in some capsule."""
    hit = np.zeros(len(points), bool)
    for start, end, radius in capsules:
        a, b = np.array(start), np.array(end)
        share = np.clip((points - a) @ (b - a) / max((b - a) @ (b - a), 1e-12), 0, 1)
        hit |= np.linalg.norm(points - a - share[:, None] * (b - a), axis=1) <= radius
    return hit


def _farthest_outside(capsules, vertices):
    """Greatest distance by which the capsules stand out of an outline."""
    rim = np.concatenate([_rim(c) for c in capsules])
    return max(0.0, signed_distance(*rim.T, vertices).max())


# How far a block's capsules may stand out of its outline: a star's spoke is rounder than its tip,
# and the 32 corners of the painted circle leave slivers.
_OUTSIDE = {"star": 0.026, "square": 1e-9, "pentagon": 1e-9, "circle": 6e-4}


@pytest.mark.parametrize("name", shapes.SHAPES)
def test_capsules_stay_within_the_outline(name):
    outline = shapes.outline(name)
    assert _farthest_outside(planar_model.block_capsules(name), outline) <= _OUTSIDE[name]


@pytest.mark.parametrize(("name", "gap"), [("star", 0.012), ("square", 0.02), ("pentagon", 0.012)])
def test_capsules_reach_the_outline_within_a_rounded_corner(name, gap):
    vertices = shapes.outline(name)
    edges = np.roll(vertices, -1, axis=0) - vertices
    edge = (vertices + np.linspace(0, 1, 21)[:, None, None] * edges).reshape(-1, 2)
    shrunk = edge * (1 - gap / np.linalg.norm(edge, axis=1, keepdims=True))
    assert _covered(shrunk, planar_model.block_capsules(name)).all()


@pytest.mark.parametrize("name", ["square", "pentagon"])
def test_middles_of_edges_are_flush(name):
    vertices, capsules = shapes.outline(name), planar_model.block_capsules(name)
    middle = (vertices + np.roll(vertices, -1, axis=0)) / 2
    assert _covered(middle * (1 - 1e-9), capsules).all()
    assert not _covered(middle * (1 + 1e-3), capsules).any()


def test_a_circle_is_one_disc_of_its_radius():
    assert planar_model.block_capsules("circle") == (((0.0, 0.0), (0.0, 0.0), 0.12),)


@pytest.mark.parametrize("part", FINGERS, ids=["left", "right"])
def test_a_fingers_capsules_stay_in_its_outline_but_for_the_elbow_and_the_root(part):
    capsules = planar_model.finger_capsules(part)
    assert all(c.radius == planar_model.FINGER_RADIUS == 0.05 / 2 for c in capsules)
    above = part.outline.copy()
    above[above[:, 1] == 0, 1] = -0.025  # the pivot lies inside the disc
    assert _farthest_outside(capsules, above) <= 0.002


@pytest.mark.parametrize("part", FINGERS, ids=["left", "right"])
def test_a_fingers_sides_are_flush_with_its_outline(part):
    root, elbow, outer_tip, inner_tip, crook, _ = part.outline
    capsules = planar_model.finger_capsules(part)
    middles = np.array([(root + elbow) / 2, (elbow + outer_tip) / 2, (inner_tip + crook) / 2])
    outward = np.array([root, (elbow + outer_tip) - (inner_tip + crook), inner_tip - outer_tip])
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    assert _covered(middles - 1e-6 * outward, capsules).all()
    assert not _covered(middles + 1e-3 * outward, capsules).any()


def test_fingers_mirror_each_other():
    left, right = (planar_model.finger_capsules(p) for p in FINGERS)
    for a, b in zip(left, right, strict=True):
        np.testing.assert_allclose(np.array(a[:2]) * [-1, 1], b[:2], atol=1e-12)


def test_a_forearm_ends_where_its_outline_ends():
    _, _, outer_tip, inner_tip, *_ = FINGERS[1].outline
    (_, _, _), (_, wrist, radius) = planar_model.finger_capsules(FINGERS[1])
    assert np.linalg.norm((outer_tip + inner_tip) / 2 - wrist) == pytest.approx(radius)
