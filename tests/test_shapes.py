"""Outlines and contact shapes against the task's specification."""

import math

import numpy as np
import pytest
from gril_jax.envs import shapes

RADIUS = 0.12  # of the circle; every other size follows from it


def _area(vertices):
    """Shoelace formula; positive for counter-clockwise outlines."""
    x, y = vertices.T
    return 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))


def _centroid(vertices):
    total, moment = 0.0, np.zeros(2)
    for (ax, ay), (bx, by) in zip(vertices, np.roll(vertices, -1, axis=0), strict=True):
        cross = ax * by - bx * ay
        total += cross
        moment += cross * np.array([ax + bx, ay + by])
    return moment / (3 * total)


def _inside(points, vertices):
    """Even-odd rule, one ray to the right a point."""
    result = np.zeros(len(points), bool)
    for (ax, ay), (bx, by) in zip(vertices, np.roll(vertices, -1, axis=0), strict=True):
        crosses = (ay > points[:, 1]) != (by > points[:, 1])
        if not crosses.any():
            continue
        x = ax + (points[:, 1] - ay) / (by - ay if by != ay else np.inf) * (bx - ax)
        result ^= crosses & (points[:, 0] < x)
    return result


def _to_outline(point, vertices):
    """Distance of one point to the outline."""
    best = np.inf
    for a, b in zip(vertices, np.roll(vertices, -1, axis=0), strict=True):
        share = np.clip((point - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        best = min(best, np.linalg.norm(point - a - share * (b - a)))
    return best


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
    """Which points lie in some capsule."""
    hit = np.zeros(len(points), bool)
    for start, end, radius in capsules:
        a, b = np.array(start), np.array(end)
        share = np.clip((points - a) @ (b - a) / max((b - a) @ (b - a), 1e-12), 0, 1)
        hit |= np.linalg.norm(points - a - share[:, None] * (b - a), axis=1) <= radius
    return hit


def test_the_four_block_shapes_are_named():
    assert shapes.BLOCK_SHAPES == ("star", "square", "pentagon", "circle")


@pytest.mark.parametrize("name", ["square", "pentagon", "circle"])
def test_blocks_have_the_circles_area(name):
    assert _area(shapes.block(name).vertices) == pytest.approx(math.pi * RADIUS**2, rel=0.01)


def test_star_has_ten_corners_on_two_radii():
    radii = np.linalg.norm(shapes.block("star").vertices, axis=1)
    np.testing.assert_allclose(radii[::2], 0.156)
    np.testing.assert_allclose(radii[1::2], 0.078)


def test_square_and_pentagon_have_the_reference_sides():
    for name, side in (("square", 0.2127), ("pentagon", 0.1622)):
        vertices = shapes.block(name).vertices
        edges = np.linalg.norm(vertices - np.roll(vertices, 1, axis=0), axis=1)
        np.testing.assert_allclose(edges, side, atol=2e-4, err_msg=name)
    pentagon = np.linalg.norm(shapes.block("pentagon").vertices, axis=1)
    np.testing.assert_allclose(pentagon, 0.1379)


def test_circle_has_the_reference_radius_all_round():
    vertices = shapes.block("circle").vertices
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), RADIUS)
    assert shapes.block("circle").capsules[0].radius == RADIUS


@pytest.mark.parametrize("name", shapes.BLOCK_SHAPES)
def test_origin_is_the_centre_of_mass_and_outlines_turn_counter_clockwise(name):
    vertices = shapes.block(name).vertices
    np.testing.assert_allclose(_centroid(vertices), 0.0, atol=1e-12)
    assert _area(vertices) > 0


@pytest.mark.parametrize("name", ["star", "pentagon", "circle"])
def test_first_vertex_is_on_plus_y(name):
    x, y = shapes.block(name).vertices[0]
    assert abs(x) < 1e-12
    assert y > 0


@pytest.mark.parametrize("name", shapes.BLOCK_SHAPES)
def test_inertia_is_the_references(name):
    expected = {"star": 9.365e-5, "square": 7.540e-5, "pentagon": 7.322e-5, "circle": 7.2e-5}
    assert shapes.block(name).inertia == expected[name]


# How far a contact shape may stand out of what is painted: a star's spoke is rounder than its
# tip, and the 32 corners of the painted circle leave slivers.
_OUTSIDE = {"star": 0.026, "square": 1e-9, "pentagon": 1e-9, "circle": 6e-4}


@pytest.mark.parametrize("name", shapes.BLOCK_SHAPES)
def test_capsules_stay_within_the_outline(name):
    shape = shapes.block(name)
    rim = np.concatenate([_rim(c) for c in shape.capsules])
    stray = rim[~_inside(rim, shape.vertices * (1 + 1e-9))]
    worst = max((_to_outline(p, shape.vertices) for p in stray), default=0.0)
    assert worst <= _OUTSIDE[name]


@pytest.mark.parametrize(("name", "gap"), [("star", 0.012), ("square", 0.02), ("pentagon", 0.012)])
def test_capsules_reach_the_outline(name, gap):
    """Only the corners are rounded off, by no more than `gap`; edges' middles are flush."""
    shape = shapes.block(name)
    edge = shape.vertices + np.linspace(0, 1, 21)[:, None, None] * (
        np.roll(shape.vertices, -1, axis=0) - shape.vertices
    )
    edge = edge.reshape(-1, 2)
    shrunk = edge * (1 - gap / np.linalg.norm(edge, axis=1, keepdims=True))
    assert _covered(shrunk, shape.capsules).all()


@pytest.mark.parametrize("name", ["square", "pentagon"])
def test_middles_of_edges_are_flush(name):
    shape = shapes.block(name)
    middle = (shape.vertices + np.roll(shape.vertices, -1, axis=0)) / 2
    assert _covered(middle * (1 - 1e-9), shape.capsules).all()
    assert not _covered(middle * (1 + 1e-3), shape.capsules).any()


@pytest.mark.parametrize(("side", "name"), [(-1, "left"), (1, "right")])
def test_finger_bends_inward_and_reaches_the_reference_length(side, name):
    vertices = shapes.finger(side).vertices
    assert vertices[:, 1].max() == pytest.approx(0.349 + 0.01, abs=0.002), name
    tip = vertices[np.argsort(vertices[:, 1])[-2:]].mean(axis=0)
    assert np.sign(tip[0]) == -side
    assert abs(tip[0]) == pytest.approx(0.14 * math.sin(math.pi / 8), abs=1e-9)
    assert shapes.finger(side).inertia == 0.005


def test_fingers_mirror_each_other():
    left, right = shapes.finger(-1).vertices * [-1, 1], shapes.finger(1).vertices
    np.testing.assert_allclose(sorted(map(tuple, left)), sorted(map(tuple, right)), atol=1e-12)


def test_arms_of_a_finger_are_its_outlines_width():
    for capsule in shapes.finger(1).capsules:
        assert capsule.radius == shapes.FINGER_RADIUS == 0.05 / 2
    (_, elbow, _), (start, _, _) = shapes.finger(1).capsules
    assert elbow == start
    rim = np.concatenate([_rim(c) for c in shapes.finger(1).capsules])
    outside = rim[~_inside(rim, shapes.finger(1).vertices)]
    assert max(_to_outline(p, shapes.finger(1).vertices) for p in outside) <= 0.0251


@pytest.mark.parametrize(("width", "inertia"), [(0.3, 0.00833), (0.6, 0.03083), (1.6, 0.21417)])
def test_stick_is_as_wide_and_deep_as_asked(width, inertia):
    shape = shapes.stadium(width, 0.1, inertia)
    np.testing.assert_allclose(np.ptp(shape.vertices, axis=0), [width, 0.1])
    (capsule,) = shape.capsules
    rim = _rim(capsule)
    np.testing.assert_allclose(np.ptp(rim, axis=0), [width, 0.1], atol=1e-9)
    assert shape.inertia == inertia
