"""Boxes in space: touch, and what is lowest, against corners."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.panda import kinematics
from gril_jax.envs.tabletop import boxes
from gril_jax.envs.tabletop.boxes import Boxes

RNG = np.random.default_rng(0)
QUATS = RNG.normal(size=(5, 4)).astype(np.float32)
QUATS /= np.linalg.norm(QUATS, axis=1, keepdims=True)
THINGS = boxes.Boxes(
    jnp.asarray(RNG.uniform(-0.3, 0.6, (5, 3)), jnp.float32),
    kinematics.rotation(jnp.asarray(QUATS)),
    jnp.asarray(RNG.uniform(0.01, 0.2, (5, 3)), jnp.float32),
)


def _corners(i):
    signs = np.array(list(itertools.product((-1, 1), repeat=3)))
    place, turn, half = (np.asarray(x[i], np.float64) for x in THINGS)
    return place + (signs * half) @ turn.T


def test_the_lowest_point_is_that_of_the_corners():
    for i in range(5):
        np.testing.assert_allclose(boxes.lowest(THINGS)[i], _corners(i)[:, 2].min(), atol=1e-6)


def _box(place, yaw=0.0, half=(0.1, 0.05, 0.02)):
    return boxes.Boxes(
        jnp.array(place, jnp.float32), kinematics.about_z(jnp.float32(yaw)), jnp.array(half)
    )


def test_touch_begins_where_faces_meet():
    small = (0.01, 0.01, 0.01)
    for gap, touch in ((-0.002, True), (0.001, True), (0.003, False)):
        other = _box((0.0, 0.06 + gap, 0.0), half=small)
        assert bool(boxes.touching(other, _box((0, 0, 0)))) == touch
    assert bool(boxes.touching(_box((0.5, 0.56, 0), 1.0, small), _box((0.5, 0.5, 0), 0.1)))


def test_a_thing_is_free_if_neither_pad_touches_it():
    far, near = _box((0, 0.3, 0), half=(0.01,) * 3), _box((0, 0.05, 0), half=(0.01,) * 3)
    thing = _box((0, 0, 0))
    both = lambda *pads: jax.tree.map(lambda *x: jnp.stack(x), *pads)  # noqa: E731
    assert bool(boxes.free(both(far, far), thing))
    assert not bool(boxes.free(both(far, near), thing))


# --- The camera's boxes against a plain pinhole, one corner at a time

CAMERA = boxes.CAMERA
project = jax.jit(boxes.project, static_argnums=0)


def _pinhole(point, camera=CAMERA):
    """A point of the world in the picture, by its two angles from the direction of view."""
    x, y, z = np.subtract(point, camera.place)
    dx, dy, dz = np.subtract(camera.target, camera.place)
    turn, tilt = np.arctan2(dy, dx), np.arctan2(dz, np.hypot(dx, dy))
    ahead, left = np.cos(turn) * x + np.sin(turn) * y, np.cos(turn) * y - np.sin(turn) * x
    depth, up = np.cos(tilt) * ahead + np.sin(tilt) * z, np.cos(tilt) * z - np.sin(tilt) * ahead
    edge = depth * np.tan(camera.field / 2)
    return np.array([-left / edge, up / edge])


def test_a_box_bounds_the_corners_that_a_pinhole_shows():
    center, size = project(CAMERA, THINGS)
    for i in range(5):
        corners = np.array([_pinhole(corner) for corner in _corners(i)])
        np.testing.assert_allclose(center[i] - size[i] / 2, corners.min(axis=0), atol=1e-5)
        np.testing.assert_allclose(center[i] + size[i] / 2, corners.max(axis=0), atol=1e-5)


def test_any_camera_keeps_the_horizon_level_and_shows_its_target_in_the_middle():
    camera = boxes.Camera((0.2, 1.3, 0.4), (0.5, 0.1, 0.7), 0.8)
    x, y, forward = boxes.axes(camera)
    assert x[2] == 0
    assert y[2] > 0
    np.testing.assert_allclose(np.linalg.det(np.stack([x, y, -forward])), 1, atol=1e-5)
    point = Boxes(jnp.array(camera.target), jnp.eye(3), jnp.zeros(3))
    center, size = project(camera, point)
    np.testing.assert_allclose(np.concatenate([center, size]), 0, atol=1e-6)
    np.testing.assert_allclose(_pinhole((0.4, 0.2, 0.5), camera), boxes.project(
        camera, point._replace(position=jnp.array([0.4, 0.2, 0.5])))[0], atol=1e-5)  # fmt: skip


def test_the_robots_left_is_on_the_right_and_what_is_nearer_is_larger():
    place = jnp.array([[0.4, 0.2, 0.1], [0.4, -0.2, 0.1], [0.8, -0.2, 0.1]])
    cubes = Boxes(place, jnp.broadcast_to(jnp.eye(3), (3, 3, 3)), jnp.full((3, 3), 0.03))
    center, size = project(CAMERA, cubes)
    assert center[0, 0] > 0 > center[1, 0]
    assert (size[2] > 1.2 * size[1]).all()


def test_projection_jits_maps_and_has_finite_gradients_even_behind_the_camera():
    plain = boxes.project(CAMERA, THINGS)
    mapped = jax.jit(jax.vmap(lambda thing: boxes.project(CAMERA, thing)))(THINGS)
    for a, b in zip(plain, mapped, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-6)
    behind = THINGS._replace(position=THINGS.position + jnp.array([3.0, 0, 0]))

    def width(position):
        return boxes.project(CAMERA, behind._replace(position=position))[1].sum()

    assert jnp.isfinite(jax.jit(jax.grad(width))(behind.position)).all()


def test_an_outline_is_the_hull_of_the_corners():
    for i in range(5):
        outline = boxes.outline(CAMERA, *(np.asarray(x[i]) for x in THINGS))
        corners = np.array([_pinhole(corner) for corner in _corners(i)])
        for vertex in outline:
            assert np.linalg.norm(corners - vertex, axis=1).min() < 1e-5
        edges = np.roll(outline, -1, axis=0) - outline
        away = corners[:, None] - outline
        assert (edges[:, 0] * away[..., 1] - edges[:, 1] * away[..., 0] > -1e-5).all()
