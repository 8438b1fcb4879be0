"""Contacts of convex polygons: against the original's engine, and an oracle in numpy.

`chipmunk_contacts.json` holds contacts that Chipmunk 7.0.2 found: of robot parts and blocks, or of
two blocks, at poses `at` and `pose`, each a normal, a gap and the point on the second body, those
that two boxes of a finger have in common but once.
"""

import functools
import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.planar import contacts, robots
from gril_jax.envs.planar import shapes as block_shapes
from gril_jax.envs.planar.contacts import Frames
from gril_jax.envs.planar.plane import Vec, heading
from gril_jax.envs.planar.polygons import meet, nearest_arms, pieces

CASES = json.loads((Path(__file__).parent / "chipmunk_contacts.json").read_text(encoding="utf-8"))
STAR, SQUARE, PENTAGON, CIRCLE = range(4)


def _frames(poses):
    x, y, angle = jnp.asarray(poses, jnp.float32).reshape(-1, 3).T
    return Frames(Vec(x, y), heading(angle))


@functools.cache
def _program(part):
    if part < 0:
        return jax.jit(lambda kinds, pair: contacts.between_blocks(
            block_shapes.blocks(kinds), _frames(pair)))  # fmt: skip
    made = robots.robot("gripper").parts[part]

    def one(kinds, pair):
        at = jax.tree.map(lambda f: f[0], _frames(pair))
        return contacts.with_part(made, at, block_shapes.blocks(kinds[1:]), _frames(pair[1:]))

    return jax.jit(one)


def _found(case):
    """Rows (normal x, y, gap, point x, y) of what touches, each once."""
    kinds = [block_shapes.SHAPES.index(case["kind"])] * 2
    if case["part"] < 0:
        kinds[0] = block_shapes.SHAPES.index(case["first"])
    layers = _program(case["part"])(jnp.array(kinds), jnp.float32([case["at"], case["pose"]]))
    rows = []
    for layer in layers:
        for i, gap in enumerate(np.asarray(layer.gap)):
            if gap <= 0:
                # Between blocks the second entry is the pair in the other order.
                sign, body = (-1, "at") if i else (1, "pose")
                n = sign * np.array([layer.normal.x[i], layer.normal.y[i]])
                point = np.array([layer.second.x[i], layer.second.y[i]]) + case[body][:2]
                rows.append([*n, gap, *(point + n * gap * (i > 0))])
    rows = np.array(rows).reshape(-1, 5)
    return rows[[not _near(row, rows[:k]) for k, row in enumerate(rows)]]


def _near(row, others):
    apart = np.abs(np.asarray(others).reshape(-1, 5) - row)
    return (apart < [2e-4, 2e-4, 1e-5, 1e-4, 1e-4]).all(axis=1).any()


@pytest.mark.parametrize("part", [-1, 0, 1, 2])
def test_contacts_are_chipmunks(part):
    """All; of stars, which it has as six pieces, the deepest, and none that it has not."""
    cases = [case for case in CASES if case["part"] == part]
    assert len(cases) >= 8
    for case in cases:
        theirs, ours = np.array(case["contacts"]), _found(case)
        assert all(_near(row, theirs) for row in ours), case
        if "star" in (case["first"], case["kind"]):
            assert _near(theirs[theirs[:, 2].argmin()], ours), case
        else:
            assert len(ours) == len(theirs), case


# ---------------------------------------------------------------- an oracle


def _depth(a, b):
    """Signed distance of two convex polygons: from the origin to their difference's hull."""
    points = (b[None] - a[:, None]).reshape(-1, 2)
    hull = _hull(points)
    ends = np.roll(hull, -1, axis=0)
    way = ends - hull
    share = np.clip(-(hull * way).sum(1) / (way**2).sum(1), 0, 1)
    distance = np.linalg.norm(hull + share[:, None] * way, axis=1).min()
    inside = (hull[:, 0] * way[:, 1] - hull[:, 1] * way[:, 0] >= 0).all()
    return -distance if inside else distance


def _hull(points):
    """The convex hull, counter-clockwise (monotone chain)."""
    points = sorted(map(tuple, np.round(points, 12)))

    def half(points):
        chain = []
        for p in points:
            while len(chain) > 1:
                a, b = chain[-2:]
                if (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0:
                    break
                chain.pop()
            chain.append(p)
        return chain[:-1]

    return np.array(half(points) + half(points[::-1]))


@jax.jit
def _meet(kinds, poses):
    shapes, places = block_shapes.blocks(kinds), _frames(poses)
    arms = nearest_arms(shapes, Vec(places.heading.x, -places.heading.y))
    made = pieces(shapes, arms[0]).placed(places.heading, places.center)
    half = lambda f, k: f[..., k::2]  # noqa: E731
    pair = [jax.tree.map(lambda f, k=k: half(f, k), made) for k in (0, 1)]
    return meet(*pair), meet(*pair[::-1]), *pair


@pytest.fixture(scope="module")
def pairs():
    """Two hundred pairs of squares, pentagons and arms of stars that touch or nearly do."""
    rng = np.random.default_rng(3)
    kinds = rng.choice([STAR, SQUARE, PENTAGON], 400)
    poses = rng.uniform([-0.1, -0.1, -3], [0.1, 0.1, 3], (400, 3))
    return jax.tree.map(np.asarray, _meet(jnp.array(kinds), jnp.float32(poses)))


def test_the_deeper_gap_is_the_polygons_distance(pairs):
    met, _, a, b = pairs
    corners = [np.stack([p.start.x, p.start.y], axis=-1).astype(float) for p in (a, b)]
    rounded = a.radius + b.radius
    exact = np.array([_depth(*(c[:, i] for c in corners)) for i in range(200)]) - rounded
    ours = np.minimum(*met.gaps)
    touch = exact < 0
    assert touch.sum() > 100
    assert (ours[~touch] > -1e-6).all()
    # A corner beside the side that faces it lies less deep than the sides overlap.
    assert (ours[touch] >= exact[touch] - 1e-5).all()
    assert np.mean(np.abs(ours - exact)[touch] < 1e-5) > 0.9


def test_what_is_the_first_point_in_one_order_is_the_second_in_the_other(pairs):
    met, back, *_ = pairs
    touch = np.minimum(*met.gaps) < 0
    np.testing.assert_allclose(met.normal.x[touch], -back.normal.x[touch], atol=1e-4)
    np.testing.assert_allclose(met.gaps[0][touch], back.gaps[1][touch], atol=1e-5)
    np.testing.assert_allclose(met.gaps[1][touch], back.gaps[0][touch], atol=1e-5)


def test_arms_are_the_nearest_and_the_next():
    rng = np.random.default_rng(0)
    towards, shapes = rng.normal(size=(50, 2)), block_shapes.blocks(jnp.full(50, STAR))
    first, second = jax.jit(nearest_arms)(shapes, Vec(*jnp.float32(towards.T)))
    tips = np.stack([shapes.directions.x[:, 0], shapes.directions.y[:, 0]], axis=1)
    order = np.argsort(-towards @ tips.T, axis=1)
    for k, arm in enumerate((first, second)):
        np.testing.assert_allclose(arm.x, tips[order[:, k], 0], atol=1e-6)
        np.testing.assert_allclose(arm.y, tips[order[:, k], 1], atol=1e-6)


def test_gradients_are_finite_however_bodies_lie():
    """On one another, side by side, and a circle's centre on a side."""
    kinds = jnp.array([SQUARE, SQUARE, CIRCLE, CIRCLE, SQUARE, CIRCLE])
    poses = jnp.float32([[0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 0, 0], [2, 0, 0], [2.1063472, 0, 0]])
    slope = jax.grad(lambda p: sum(f.sum() for f in jax.tree.leaves(_meet(kinds, p)[0])))(poses)
    assert np.isfinite(slope).all()
