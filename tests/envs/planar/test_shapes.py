"""Distances to the blocks' rims against polygons in numpy, and what else their table says."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.planar import plane, robots
from gril_jax.envs.planar import shapes as block_shapes
from gril_jax.envs.planar.plane import Vec, fence, heading
from gril_jax.envs.planar.polygons import nearest_arms
from hypothesis import given, settings
from hypothesis import strategies as st
from support import planar_scenes, scenes

ROUNDED = {"star": 0.0, "square": 0.002127, "pentagon": 0.0, "circle": 0.0}  # radius of the corners


def _points(count=400, reach=0.3, seed=0):
    return np.random.default_rng(seed).uniform(-reach, reach, (count, 2))


def _exact(name, points):
    if name == "circle":
        return np.linalg.norm(points, axis=1) - 0.12
    return planar_scenes.signed_distance(*points.T, scenes.corners(name)) - ROUNDED[name]


def _signed_distance(shape, point):
    return block_shapes.arm_distance(shape, point, nearest_arms(shape, point)[0])


def _ours(name, points):
    """Distances (P,) and normals (P, 2)."""
    shape = block_shapes.blocks(jnp.array([block_shapes.SHAPES.index(name)]))
    x, y = jnp.asarray(points, jnp.float32).T[..., None]
    distance, normal = jax.jit(_signed_distance)(shape, Vec(x, y))
    return np.asarray(distance)[:, 0], np.concatenate([normal.x, normal.y], axis=1)


@pytest.mark.parametrize("name", block_shapes.SHAPES)
def test_distance_outside_is_the_polygons(name):
    points = _points()
    exact, (ours, _) = _exact(name, points), _ours(name, points)
    outside = exact > 1e-4
    assert outside.sum() > 100
    np.testing.assert_allclose(ours[outside], exact[outside], atol=1e-4)


@pytest.mark.parametrize("name", block_shapes.SHAPES)
def test_depth_inside_is_the_polygons_and_at_most_that_in_a_star(name):
    """Behind a star's notch the depth is that below the rim's line, which is a little less."""
    points = _points(reach=0.15, seed=1)
    exact, (ours, _) = _exact(name, points), _ours(name, points)
    inside = exact < -1e-4
    assert inside.sum() > 100
    assert (ours[inside] < 0).all()
    if name == "star":
        assert (ours[inside] >= exact[inside] - 1e-4).all()
    else:
        np.testing.assert_allclose(ours[inside], exact[inside], atol=1e-4)


@pytest.mark.parametrize("name", block_shapes.SHAPES)
def test_normals_are_units_along_which_the_distance_grows_as_fast_as_it_can(name):
    points = _points(seed=2)
    distance, normal = _ours(name, points)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, atol=1e-4)
    clear = np.abs(distance) > 2e-3
    further, _ = _ours(name, points + 1e-3 * normal)
    grown = (further - distance)[clear]
    assert grown.max() < 1.03e-3
    # Before a star's notch two rims are as near, and the nearer may change on the way.
    assert np.mean(grown > 0.97e-3) >= (0.98 if name == "star" else 1)


@pytest.mark.parametrize("name", block_shapes.SHAPES)
def test_the_nearest_point_of_the_rim_lies_back_along_the_normal(name):
    points = _points(seed=3)
    distance, normal = _ours(name, points)
    outside = distance > 1e-3
    foot = points - distance[:, None] * normal
    np.testing.assert_allclose(_exact(name, foot)[outside], 0.0, atol=2e-4)


def test_the_centre_itself_is_finite():
    for name in block_shapes.SHAPES:
        distance, normal = _ours(name, np.zeros((1, 2)))
        assert -0.13 < distance[0] < -0.05
        np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, atol=1e-4)


@pytest.mark.parametrize("name", block_shapes.SHAPES)
def test_extents_are_those_of_the_turned_outline(name):
    angles = np.linspace(-4, 4, 23)
    shapes = block_shapes.blocks(jnp.full(23, block_shapes.SHAPES.index(name)))
    low, high = block_shapes.extents(shapes, jnp.asarray(angles, jnp.float32))
    for a, lowest, highest in zip(angles, low, high, strict=True):
        turned = scenes.placed(scenes.corners(name), 0, 0, a)
        margin = ROUNDED[name]
        # The test's circle has 60 corners.
        np.testing.assert_allclose(lowest, turned.min(axis=0) - margin, atol=4e-4)
        np.testing.assert_allclose(highest, turned.max(axis=0) + margin, atol=4e-4)


@pytest.mark.parametrize("name", block_shapes.SHAPES)
def test_outline_runs_counter_clockwise_around_the_specified_area(name):
    outline = block_shapes.outline(name)
    x, y = outline.T
    area = 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
    expected = scenes.corners(name)
    x, y = expected.T
    assert area == pytest.approx(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y), rel=0.01)
    if name != "circle":
        distances = np.linalg.norm(outline[:, None] - expected, axis=-1)
        assert distances.min(axis=1).max() < 1e-4
        assert len(outline) == len(expected)


def test_inertias_are_the_references():
    shapes = block_shapes.blocks(jnp.arange(4))
    inertia = dict(zip(block_shapes.SHAPES, 1 / np.asarray(shapes.inverse_inertia), strict=True))
    of_half = {  # as the original's engine computes them for a mass of 0.5
        "star": 0.004682686464592393, "square": 0.0037699111843077504,
        "pentagon": 0.0036611027179584824, "circle": 0.0036,
    }  # fmt: skip
    for name, value in of_half.items():
        assert inertia[name] == pytest.approx(value / 50, rel=1e-6)


def test_a_mix_of_blocks_is_each_block_alone():
    order, points = [2, 0, 3, 3, 1], _points(5, seed=4)
    x, y = jnp.asarray(points, jnp.float32).T
    mixed, _ = _signed_distance(block_shapes.blocks(jnp.array(order)), Vec(x, y))
    alone = [
        _ours(block_shapes.SHAPES[k], p[None])[0][0] for k, p in zip(order, points, strict=True)
    ]
    np.testing.assert_allclose(mixed, alone, atol=1e-6)


# --- Vectors of the plane against complex numbers; `fence` changes nothing

_NUMBERS = st.complex_numbers(max_magnitude=10, allow_nan=False)
_ANGLES = st.floats(-4, 4)


def _vec(z):
    return Vec(jnp.float32(z.real), jnp.float32(z.imag))


def _complex(v):
    return np.asarray(v.x, np.float64) + 1j * np.asarray(v.y, np.float64)


@settings(max_examples=40, deadline=None)
@given(_NUMBERS, _NUMBERS, st.floats(-3, 3))
def test_arithmetic_and_products_are_those_of_complex_numbers(z, w, scale):
    a, b, product = _vec(z), _vec(w), z.conjugate() * w
    found = [a + b, a - b, -a, a * scale, a.turned(), Vec(a.dot(b), a.cross(b))]
    wanted = [z + w, z - w, -z, scale * z, 1j * z, product]
    np.testing.assert_allclose([_complex(v) for v in found], wanted, atol=1e-4)


@settings(max_examples=40, deadline=None)
@given(_NUMBERS, _ANGLES, _ANGLES)
def test_frames_rotate_out_and_back_and_compose(z, one, two):
    turn, other = heading(jnp.float32(one)), heading(jnp.float32(two))
    out = _vec(z).out_of(turn)
    np.testing.assert_allclose(_complex(out), z * np.exp(1j * one), atol=1e-4)
    np.testing.assert_allclose(_complex(out.into(turn)), z, atol=1e-4)
    np.testing.assert_allclose(_complex(other.out_of(turn)), np.exp(1j * (one + two)), atol=1e-5)


def test_choice_and_order_are_numpys():
    a, b = (Vec(*jnp.asarray(x)) for x in np.random.default_rng(0).normal(size=(2, 2, 7)))
    picked = np.where(np.asarray(a.x) > 0, _complex(a), _complex(b))
    np.testing.assert_array_equal(_complex(plane.where(a.x > 0, a, b)), picked)
    np.testing.assert_array_equal(_complex(a[2:5]), _complex(a)[2:5])


TREES = [
    {"one": jnp.arange(6.0).reshape(2, 3), "two": (jnp.float32(7.0), jnp.ones(5))},
    Vec(jnp.arange(4.0), -jnp.arange(4.0)),
    [jnp.zeros((0, 3)), jnp.arange(3.0)],
    jnp.float32(2.0),
]


@pytest.mark.parametrize("tree", TREES)
def test_a_fence_returns_the_same_arrays(tree):
    lanes = jax.tree.map(lambda x: jnp.stack([x, x]), tree)
    for given_, again in (
        (tree, fence(tree)), (tree, jax.jit(fence)(tree)), (lanes, jax.jit(jax.vmap(fence))(lanes))
    ):  # fmt: skip
        assert jax.tree.structure(again) == jax.tree.structure(given_)
        for before, after in zip(jax.tree.leaves(given_), jax.tree.leaves(again), strict=True):
            assert before.dtype == after.dtype
            np.testing.assert_array_equal(before, after)


# --- The robots' masses and shapes are the specification's

OPEN = robots.FINGER_OPEN


def _finger(side, opening):
    """Outline of a finger in the base's frame; side 0 is the left."""
    part, sign = robots.robot("gripper").parts[1 + side], (1, -1)[side]
    return planar_scenes.turned(part.outline, sign * opening) + robots.PIVOTS[side]


def _gap(opening):
    """Smallest distance between the corners of both fingers' forearms."""
    left, right = _finger(0, opening), _finger(1, opening)
    ahead = 0.25  # the forearms' ends
    left, right = left[left[:, 1] > ahead], right[right[:, 1] > ahead]
    return np.linalg.norm(left[:, None] - right, axis=-1).min()


def test_fingers_leave_the_references_gap():
    assert _gap(OPEN) == pytest.approx(0.29, abs=0.01)
    assert _gap(0.0) == pytest.approx(0.03, abs=0.01)


def test_the_farthest_corner_of_a_finger_is_where_the_reference_has_it():
    for side in (1, 2):
        finger = robots.robot("gripper").parts[side]
        assert finger.outline[:, 1].max() == pytest.approx(0.349, abs=1e-3)
        assert finger.corners[:, 1].max() == pytest.approx(0.349, abs=1e-3)


@pytest.mark.parametrize("opening", [0.0, 0.2, OPEN])
def test_fingers_mirror_each_other(opening):
    left, right = _finger(0, opening), _finger(1, opening)
    np.testing.assert_allclose(left * [-1, 1], right, atol=1e-12)


def test_forearms_bend_inwards():
    tip = _finger(0, 0.0)[:, 1].argmax()
    assert _finger(0, 0.0)[tip, 0] > robots.PIVOTS[0, 0]


def test_boxes_of_a_finger_have_the_specified_sides():
    for side in (1, 2):
        upper, fore = robots.robot("gripper").parts[side].boxes
        np.testing.assert_allclose(2 * np.array(upper.half), [0.05, 0.22])
        np.testing.assert_allclose(2 * np.array(fore.half), [0.05, 0.14])
        assert abs(fore.angle) == pytest.approx(math.pi / 8)
        assert upper.angle == 0


def test_outline_of_a_finger_is_the_rim_of_its_two_boxes():
    """Each outline corner lies on a box's rim or in the other box; both boxes lie inside it."""
    for side in (1, 2):
        part = robots.robot("gripper").parts[side]
        for point in part.outline:
            inside = []
            for box in part.boxes:
                local = planar_scenes.turned(point - np.array(box.center), -box.angle)
                inside.append((np.abs(local) - box.half).max())
            assert min(inside) == pytest.approx(0.0, abs=1e-9)


def test_masses_and_inertias_are_the_references():
    gripper = robots.robot("gripper")
    assert sum(p.mass for p in gripper.parts) == pytest.approx(1.25)
    # Of the fingers as the original's engine computes them, which gives the left one more.
    inertias = [p.inertia for p in gripper.parts]
    assert inertias == pytest.approx([0.020, 0.00500649436186835, 0.004983019517209478], rel=1e-9)
    assert [p.friction for p in gripper.parts] == [0.5, 5.0, 5.0]
    assert gripper.has_fingers
    for name, inertia in (("short", 0.00833), ("medium", 0.03083), ("long", 0.21417)):
        stick = robots.robot(name)
        (part,) = stick.parts
        assert (part.mass, part.friction) == (1.0, 0.5)
        assert part.inertia == pytest.approx(inertia, abs=5e-6)
        assert not stick.has_fingers


@pytest.mark.parametrize(("name", "width"), [("short", 0.3), ("medium", 0.6), ("long", 1.6)])
def test_sticks_are_boxes_across_the_way_whose_inertia_is_a_boxs(name, width):
    (part,) = robots.robot(name).parts
    np.testing.assert_allclose(np.ptp(part.outline, axis=0), [width, 0.1])
    assert part.inertia == pytest.approx((width**2 + 0.1**2) / 12, rel=1e-3)


def test_every_robot_has_its_name():
    assert [robots.robot(name).name for name in robots.ROBOTS] == list(robots.ROBOTS)
