"""Boxes in space: touch, and what is lowest, against corners."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.panda import kinematics
from gril_jax.envs.tabletop import boxes

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
