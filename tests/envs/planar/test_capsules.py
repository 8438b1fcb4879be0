"""The capsules against the outlines that they stand for."""

import math

import numpy as np
import pytest
from gril_jax.envs.planar import model as planar_model
from gril_jax.envs.planar import robots, shapes
from support.planar_scenes import signed_distance

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
