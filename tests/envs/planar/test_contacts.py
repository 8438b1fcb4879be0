"""Gaps, normals and points of contact in scenes whose answer is known in closed form."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.planar import contacts, robots
from gril_jax.envs.planar import shapes as block_shapes
from gril_jax.envs.planar.contacts import Frames
from gril_jax.envs.planar.plane import Vec, heading

STAR, SQUARE, PENTAGON, CIRCLE = range(4)
SIDE = np.sqrt(np.pi) * 0.12
ROUND = 0.01 * SIDE  # radius of the square's corners
HALF = SIDE / 2 + ROUND  # of the square, with its rounded corners
ARENA = 1.1
MOST = 40  # blocks that a compiled program takes


def _frames(poses):
    x, y, angle = jnp.asarray(poses, jnp.float32).reshape(-1, 3).T
    return Frames(Vec(x, y), heading(angle))


def _at(pose):
    return jax.tree.map(lambda f: f[0], _frames([pose]))


def _shapes(*kinds):
    return block_shapes.blocks(jnp.array(kinds))


@functools.cache
def _program(robot, part):
    made = robots.robot(robot).parts[part]
    return jax.jit(
        lambda at, kinds, poses: contacts.with_part(
            made, _at(at), block_shapes.blocks(kinds), _frames(poses)
        )
    )


def _with(robot, kinds, poses, at=(0.0, 0.0, 0.0), part=0):
    """Blocks are repeated up to forty, so that each part compiles once."""
    many = np.resize(np.int32(kinds), MOST), np.resize(np.float32(poses), (MOST, 3))
    found = _program(robot, part)(np.float32(at), *many)
    return jax.tree.map(lambda f: np.asarray(f)[: len(kinds)], found)


@jax.jit
def _between(kinds, poses):
    return contacts.between_blocks(block_shapes.blocks(kinds), _frames(poses))


def _length(v):
    return np.hypot(v.x, v.y)


# ---------------------------------------------------------------- robot and blocks


@pytest.mark.parametrize("gap", [0.3, 0.0, -0.05])
def test_disc_and_circle_are_apart_by_the_distance_less_both_radii(gap):
    directions = np.linspace(0, 6, 7)
    x, y = (0.32 + gap) * np.cos(directions), (0.32 + gap) * np.sin(directions)
    poses = np.stack([x, y, directions], axis=1) + [0.1, -0.2, 0]
    found, second = _with("gripper", [CIRCLE] * 7, poses, at=(0.1, -0.2, 0.4))
    assert (second.gap > 100).all()  # only a star has a second arm
    np.testing.assert_allclose(found.gap, gap, atol=1e-6)
    np.testing.assert_allclose(found.normal.x, np.cos(directions), atol=1e-5)
    np.testing.assert_allclose(found.normal.y, np.sin(directions), atol=1e-5)
    np.testing.assert_allclose(found.second.x, -0.12 * np.cos(directions), atol=1e-5)
    np.testing.assert_allclose(found.second.y, -0.12 * np.sin(directions), atol=1e-5)


@pytest.mark.parametrize("gap", [0.1, 0.0, -0.02])
def test_disc_and_square_meet_at_the_middle_of_its_face(gap):
    found, _ = _with("gripper", [SQUARE], [(0.2 + HALF + gap, 0.0, np.pi / 2)])
    assert float(found.gap[0]) == pytest.approx(gap, abs=1e-6)
    assert (float(found.normal.x[0]), float(found.normal.y[0])) == pytest.approx((1, 0), abs=1e-6)
    assert float(found.second.x[0]) == pytest.approx(-HALF, abs=1e-5)
    assert float(found.second.y[0]) == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize("gap", [0.02, 0.0, -0.02])
def test_a_square_flat_before_a_stick_has_a_point_on_either_side(gap):
    right, left = _with("medium", [SQUARE], [(0.0, 0.05 + HALF + gap, 0.0)])
    for found, side in ((right, 1), (left, -1)):
        assert float(found.gap[0]) == pytest.approx(gap, abs=1e-6)
        assert float(found.normal.y[0]) == pytest.approx(1.0, abs=1e-5)
        assert float(found.second.x[0]) * side == pytest.approx(HALF - ROUND, abs=1e-5)
        assert float(found.second.y[0]) == pytest.approx(-HALF, abs=1e-5)


@pytest.mark.parametrize("gap", [0.02, 0.0, -0.02])
def test_a_circle_before_a_stick_touches_once_where_it_is_nearest(gap):
    found, second = _with("medium", [CIRCLE] * 2, [(0.1, 0.17 + gap, 0), (-0.1, -0.17 - gap, 0)])
    np.testing.assert_allclose(found.gap, gap, atol=1e-6)
    np.testing.assert_allclose(found.normal.y, [1, -1], atol=1e-5)
    np.testing.assert_allclose(found.second.y, [-0.12, 0.12], atol=1e-5)
    assert (second.gap > 100).all()


def test_a_stick_end_that_digs_into_a_block_is_found_though_no_block_corner_is_inside():
    """The corner of the stick is 0.01 below the face of a square that is wider than the stick."""
    depth = 0.01
    pose = (0.15 + HALF - depth, 0.0, 0.0)
    found = _with("short", [SQUARE], [pose])
    assert min(float(f.gap[0]) for f in found) == pytest.approx(-depth, abs=1e-5)
    for f in found:
        if float(f.gap[0]) < 0:
            assert float(f.normal.x[0]) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("x", [-0.066, 0.066])
def test_a_corner_that_sinks_in_at_a_sticks_end_is_pushed_out_in_front(x):
    """Its nearest face is the stick's end, which would let the whole block through."""
    found = _with("short", [SQUARE], [(x, 0.129, 0.24)])
    pressed = [f for f in found if float(f.gap[0]) < 0]
    assert pressed
    for f in pressed:
        assert float(f.normal.y[0]) > 0.9, f


@pytest.mark.parametrize("depth", [0.01, 0.03, 0.045])
def test_a_star_tip_leaves_a_finger_on_the_side_of_the_stars_middle(depth):
    """However deep: a finger is thin, and beyond its middle the other side is nearer."""
    part = robots.robot("gripper").parts[2]
    box = part.boxes[0]
    x = box.center[0] + box.half[0] - depth + 0.156  # one tip points at the finger, from the right
    found = _with("gripper", [STAR], [(x, box.center[1], np.pi / 2)], part=2)
    deepest = min(found, key=lambda f: float(f.gap[0]))
    assert float(deepest.gap[0]) == pytest.approx(-depth, abs=1e-4)
    assert float(deepest.normal.x[0]) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("side", [0, 1])
def test_fingers_hold_a_circle_from_both_sides(side):
    """Beside the upper arm of a closed finger, whose half thickness is 0.025, on its outside."""
    sign = (-1, 1)[side]
    for gap in (0.01, 0.0, -0.01):
        pose = (sign * (0.025 + 0.12 + gap), 0.1, 0.0)
        found = _with("gripper", [CIRCLE], [pose], part=1 + side)
        nearest = min(found, key=lambda f: float(f.gap[0]))
        assert float(nearest.gap[0]) == pytest.approx(gap, abs=1e-5)
        assert float(nearest.normal.x[0]) == pytest.approx(sign, abs=1e-4)


@pytest.mark.parametrize("robot", robots.ROBOTS)
def test_a_turn_of_the_whole_scene_turns_all_contacts(robot):
    rng = np.random.default_rng(0)
    kinds = [STAR, SQUARE, PENTAGON, CIRCLE]
    poses = rng.uniform([-0.4, -0.4, -3], [0.4, 0.4, 3], (4, 3))
    c, s, turn = np.cos(0.7), np.sin(0.7), jnp.float32(0.7)
    turned = np.stack([c * poses[:, 0] - s * poses[:, 1], s * poses[:, 0] + c * poses[:, 1],
                       poses[:, 2] + 0.7], axis=1)  # fmt: skip
    before, after = _with(robot, kinds, poses), _with(robot, kinds, turned, at=(0, 0, 0.7))
    deepest = [np.min([f.gap for f in layers], axis=0) for layers in (before, after)]
    np.testing.assert_allclose(*deepest, atol=1e-5)
    for a, b in zip(before, after, strict=True):
        near = np.asarray(a.gap) < 1
        # A circle's one corner may count as right of its middle or left.
        np.testing.assert_allclose(a.gap[:3], b.gap[:3], atol=1e-5)
        expected = a.normal.out_of(heading(turn))
        # Where two corners are as deep, either may win; normals are then compared by length.
        same = near & (np.abs(np.asarray(expected.x - b.normal.x)) < 1e-3)
        assert same.sum() >= 0.7 * near.sum()


@pytest.mark.parametrize("robot", robots.ROBOTS)
def test_normals_are_units_and_point_from_the_robot_to_the_block(robot):
    rng = np.random.default_rng(1)
    kinds = rng.integers(0, 4, 40)
    angle, away = rng.uniform(-3, 3, 40), rng.uniform(1.0, 1.2, 40)
    poses = np.stack([away * np.cos(angle), away * np.sin(angle), angle], axis=1)
    for found in _with(robot, kinds, poses):
        used = np.asarray(found.gap) < 100
        np.testing.assert_allclose(_length(found.normal)[used], 1.0, atol=1e-4)
        towards = found.normal.dot(_frames(poses).center + found.second)
        assert (np.asarray(towards)[used] > -1e-5).all()
        assert (np.asarray(found.gap) > 0).all()


# ---------------------------------------------------------------- blocks


@pytest.mark.parametrize("gap", [0.1, 0.0, -0.03])
def test_two_circles_touch_in_one_point(gap):
    (layer,) = _between(np.int32([CIRCLE] * 2), np.float32([(0, 0, 0), (0.24 + gap, 0, 1)]))
    assert float(layer.gap[0]) == pytest.approx(gap, abs=1e-6)
    assert (float(layer.normal.x[0]), float(layer.normal.y[0])) == pytest.approx((1, 0), abs=1e-5)
    assert float(layer.second.x[0]) == pytest.approx(-0.12, abs=1e-5)
    assert float(layer.gap[1]) > 100


@pytest.mark.parametrize("depth", [-0.02, 0.0, 0.02])
@pytest.mark.parametrize("turn", [0.01, -0.01])
def test_a_corner_of_a_square_in_the_face_of_another(depth, turn):
    """The first is turned by about 45 degrees: its rounded corner looks at the second's face."""
    reach = (HALF - ROUND) * np.sqrt(2) * np.cos(turn) + ROUND
    poses = [(0, 0, np.pi / 4 + turn), (reach + HALF - depth, 0, 0)]
    (layer,) = _between(np.int32([SQUARE] * 2), np.float32(poses))
    one = int(np.argmin(layer.gap))  # the corner is the first point in one of both orders
    assert float(layer.gap[one]) == pytest.approx(-depth, abs=1e-5)
    assert float(layer.gap[1 - one]) > 0.05
    assert float(layer.normal.x[one]) == pytest.approx((1, -1)[one], abs=1e-5)
    expected = (-HALF, reach)[one]
    assert float(layer.second.x[one]) == pytest.approx(expected, abs=1e-5)


def test_layers_pair_each_block_with_each_other():
    """Layer k has the blocks k places on; gaps of circles tell who met whom, and once."""
    x = np.array([0.0, 1.0, 3.0, 7.0, 15.0])
    poses = np.stack([x, 0 * x, 0 * x], axis=1)
    layers = _between(np.int32([CIRCLE] * 5), np.float32(poses))
    assert len(layers) == 4
    for k, layer in enumerate(layers, start=1):
        np.testing.assert_allclose(layer.gap[:-k], (x[k:] - x[:-k]) - 0.24, rtol=1e-5)
        assert (layer.gap[-k:] > 100).all()


def test_a_single_block_meets_no_other():
    assert contacts.between_blocks(_shapes(STAR), _frames([(0, 0, 0)])) == []


# ---------------------------------------------------------------- walls


@jax.jit
def _walls_of(kinds, poses):
    shapes = block_shapes.blocks(kinds)
    return contacts.walls(shapes.corners, shapes.radius, _frames(poses), arena=ARENA)


def _walls(kinds, poses):
    return _walls_of(np.int32(kinds), np.float32(poses))


@pytest.mark.parametrize("kind", range(4))
@pytest.mark.parametrize("turn", [0.0, 0.3, 2.0])
def test_depth_in_a_wall_is_the_overhang_of_the_block(kind, turn):
    """At each of the four walls, against the block's extents."""
    low, high = block_shapes.extents(_shapes(kind), jnp.array([turn]))
    places = [(1.0, 0.1), (-1.0, 0.1), (0.1, 1.0), (0.1, -1.0)]
    inward = [(-1, 0), (1, 0), (0, -1), (0, 1)]
    layers = _walls([kind] * 4, [(x, y, turn) for x, y in places])
    for wall, ((x, y), (nx, ny)) in enumerate(zip(places, inward, strict=True)):
        axis = 0 if nx else 1
        at, n = (x, y)[axis], (nx, ny)[axis]
        expected = ARENA - (at + float(high[0, axis]) if n < 0 else -at - float(low[0, axis]))
        pair = layers[2 * axis : 2 * axis + 2]
        found = min(pair, key=lambda f, w=wall: float(f.gap[w]))
        assert float(found.gap[wall]) == pytest.approx(expected, abs=1e-5)
        normal = float(found.normal.x[wall]), float(found.normal.y[wall])
        assert normal == pytest.approx((nx, ny), abs=1e-6)  # from the wall to the block
        reach = float((found.second.x, found.second.y)[axis][wall])
        assert at + reach == pytest.approx(-n * (ARENA - expected), abs=1e-5)


def test_a_square_flat_at_a_wall_has_a_corner_on_either_side():
    first, second, *_ = _walls([SQUARE], [(ARENA - HALF, 0.0, 0.0)])
    for found, side in ((first, 1), (second, -1)):
        assert float(found.gap[0]) == pytest.approx(0.0, abs=1e-6)
        assert float(found.second.y[0]) == pytest.approx(side * (HALF - ROUND), abs=1e-5)


# ---------------------------------------------------------------- transformations


def _contacts(pose):
    """Of four blocks with a finger and with each other."""
    kinds, frames = _shapes(STAR, SQUARE, PENTAGON, CIRCLE), _frames(pose)
    found = contacts.with_part(robots.robot("gripper").parts[1], _at((0, 0, 0)), kinds, frames)
    # All of them: with gaps alone the older code generator repeats work without end.
    return jax.tree.leaves(found + contacts.between_blocks(kinds, frames))


@pytest.fixture(scope="module")
def lanes():
    rng = np.random.default_rng(2)
    return rng.uniform([-0.5, -0.5, -3], [0.5, 0.5, 3], (6, 4, 3)).astype(np.float32)


def test_vmap_is_a_loop(lanes):
    loop = zip(*map(jax.jit(_contacts), lanes), strict=True)
    for together, alone in zip(jax.jit(jax.vmap(_contacts))(lanes), loop, strict=True):
        np.testing.assert_allclose(together, alone, atol=1e-5)


@pytest.mark.slow  # each of its operations is a program
def test_jit_is_plain(lanes):
    for compiled, plain in zip(jax.jit(_contacts)(lanes[0]), _contacts(lanes[0]), strict=True):
        np.testing.assert_allclose(compiled, plain, atol=1e-5)
