"""The camera's boxes against a plain pinhole, one corner at a time."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.panda import kinematics
from gril_jax.envs.tabletop import boxes as cameras
from gril_jax.envs.tabletop.boxes import Boxes

RNG = np.random.default_rng(0)
QUATS = RNG.normal(size=(5, 4)).astype(np.float32)
QUATS /= np.linalg.norm(QUATS, axis=1, keepdims=True)
THINGS = Boxes(
    jnp.asarray(RNG.uniform(-0.3, 0.6, (5, 3)), jnp.float32),
    kinematics.rotation(jnp.asarray(QUATS)),
    jnp.asarray(RNG.uniform(0.01, 0.2, (5, 3)), jnp.float32),
)
CAMERA = cameras.CAMERA
project = jax.jit(cameras.project, static_argnums=0)


def _pinhole(point, camera=CAMERA):
    """A point of the world in the picture, by its two angles from the direction of view."""
    x, y, z = np.subtract(point, camera.place)
    dx, dy, dz = np.subtract(camera.target, camera.place)
    turn, tilt = np.arctan2(dy, dx), np.arctan2(dz, np.hypot(dx, dy))
    ahead, left = np.cos(turn) * x + np.sin(turn) * y, np.cos(turn) * y - np.sin(turn) * x
    depth, up = np.cos(tilt) * ahead + np.sin(tilt) * z, np.cos(tilt) * z - np.sin(tilt) * ahead
    edge = depth * np.tan(camera.field / 2)
    return np.array([-left / edge, up / edge])


def _corners(i):
    place, turn, half = (np.asarray(x[i], np.float64) for x in THINGS)
    signs = itertools.product((-1, 1), repeat=3)
    return np.array([_pinhole(place + turn @ (np.array(s) * half)) for s in signs])


def test_a_box_bounds_the_corners_that_a_pinhole_shows():
    center, size = project(CAMERA, THINGS)
    for i in range(5):
        corners = _corners(i)
        np.testing.assert_allclose(center[i] - size[i] / 2, corners.min(axis=0), atol=1e-5)
        np.testing.assert_allclose(center[i] + size[i] / 2, corners.max(axis=0), atol=1e-5)


def test_any_camera_keeps_the_horizon_level_and_shows_its_target_in_the_middle():
    camera = cameras.Camera((0.2, 1.3, 0.4), (0.5, 0.1, 0.7), 0.8)
    x, y, forward = cameras.axes(camera)
    assert x[2] == 0
    assert y[2] > 0
    np.testing.assert_allclose(np.linalg.det(np.stack([x, y, -forward])), 1, atol=1e-5)
    point = Boxes(jnp.array(camera.target), jnp.eye(3), jnp.zeros(3))
    center, size = project(camera, point)
    np.testing.assert_allclose(np.concatenate([center, size]), 0, atol=1e-6)
    np.testing.assert_allclose(_pinhole((0.4, 0.2, 0.5), camera), cameras.project(
        camera, point._replace(position=jnp.array([0.4, 0.2, 0.5])))[0], atol=1e-5)  # fmt: skip


def test_the_robots_left_is_on_the_right_and_what_is_nearer_is_larger():
    place = jnp.array([[0.4, 0.2, 0.1], [0.4, -0.2, 0.1], [0.8, -0.2, 0.1]])
    cubes = Boxes(place, jnp.broadcast_to(jnp.eye(3), (3, 3, 3)), jnp.full((3, 3), 0.03))
    center, size = project(CAMERA, cubes)
    assert center[0, 0] > 0 > center[1, 0]
    assert (size[2] > 1.2 * size[1]).all()


def test_projection_jits_maps_and_has_finite_gradients_even_behind_the_camera():
    plain = cameras.project(CAMERA, THINGS)
    mapped = jax.jit(jax.vmap(lambda boxes: cameras.project(CAMERA, boxes)))(THINGS)
    for a, b in zip(plain, mapped, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-6)
    behind = THINGS._replace(position=THINGS.position + jnp.array([3.0, 0, 0]))

    def width(position):
        return cameras.project(CAMERA, behind._replace(position=position))[1].sum()

    assert jnp.isfinite(jax.jit(jax.grad(width))(behind.position)).all()


def test_an_outline_is_the_hull_of_the_corners():
    for i in range(5):
        outline = cameras.outline(CAMERA, *(np.asarray(x[i]) for x in THINGS))
        corners = _corners(i)
        for vertex in outline:
            assert np.linalg.norm(corners - vertex, axis=1).min() < 1e-5
        edges = np.roll(outline, -1, axis=0) - outline
        away = corners[:, None] - outline
        assert (edges[:, 0] * away[..., 1] - edges[:, 1] * away[..., 0] > -1e-5).all()
