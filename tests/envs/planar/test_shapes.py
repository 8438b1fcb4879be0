"""Distances to the blocks' rims against polygons in numpy, and what else their table says."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.planar import shapes as block_shapes
from gril_jax.envs.planar.plane import Vec
from gril_jax.envs.planar.polygons import nearest_arms
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
