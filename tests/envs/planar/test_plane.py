"""Vectors of the plane against complex numbers; `fence` changes nothing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.planar import plane
from gril_jax.envs.planar.plane import Vec, fence, heading


def _complex(v):
    return np.asarray(v.x, np.float64) + 1j * np.asarray(v.y, np.float64)


@pytest.fixture
def vectors():
    a, b = np.random.default_rng(0).normal(size=(2, 2, 7)).astype(np.float32)
    return Vec(jnp.asarray(a[0]), jnp.asarray(a[1])), Vec(jnp.asarray(b[0]), jnp.asarray(b[1]))


@pytest.fixture
def frame():
    angle = np.linspace(-4, 4, 7, dtype=np.float32)
    return angle, heading(jnp.asarray(angle))


def test_arithmetic_is_that_of_complex_numbers(vectors):
    a, b = vectors
    for ours, theirs in (
        (a + b, _complex(a) + _complex(b)),
        (a - b, _complex(a) - _complex(b)),
        (-a, -_complex(a)),
        (a * 2.5, 2.5 * _complex(a)),
        (a.turned(), 1j * _complex(a)),
    ):
        np.testing.assert_allclose(_complex(ours), theirs, atol=1e-6)


def test_products_are_the_parts_of_the_complex_one(vectors):
    a, b = vectors
    product = _complex(a).conj() * _complex(b)
    np.testing.assert_allclose(a.dot(b), product.real, atol=1e-6)
    np.testing.assert_allclose(a.cross(b), product.imag, atol=1e-6)


def test_out_of_a_frame_rotates_and_into_it_rotates_back(vectors, frame):
    (a, b), (angle, turn) = vectors, frame
    np.testing.assert_allclose(_complex(turn), np.exp(1j * angle), atol=1e-6)
    out = a.out_of(turn)
    np.testing.assert_allclose(_complex(out), _complex(a) * np.exp(1j * angle), atol=1e-5)
    np.testing.assert_allclose(_complex(out.into(turn)), _complex(a), atol=1e-5)
    np.testing.assert_allclose(out.dot(b.out_of(turn)), a.dot(b), atol=1e-5)
    np.testing.assert_allclose(out.cross(b.out_of(turn)), a.cross(b), atol=1e-5)


def test_rotations_compose(frame):
    angle, turn = frame
    twice = turn.out_of(heading(jnp.asarray(2 * angle)))
    np.testing.assert_allclose(_complex(twice), np.exp(3j * angle), atol=1e-5)


def test_choice_and_order_are_numpys(vectors):
    a, b = vectors
    chosen = plane.where(a.x > 0, a, b)
    picked = np.where(np.asarray(a.x) > 0, _complex(a), _complex(b))
    np.testing.assert_array_equal(_complex(chosen), picked)
    np.testing.assert_array_equal(_complex(a[2:5]), _complex(a)[2:5])


TREES = [
    {"one": jnp.arange(6.0).reshape(2, 3), "two": (jnp.float32(7.0), jnp.ones(5))},
    Vec(jnp.arange(4.0), -jnp.arange(4.0)),
    [jnp.zeros((0, 3)), jnp.arange(3.0)],
    jnp.float32(2.0),
]


@pytest.mark.parametrize("tree", TREES)
@pytest.mark.parametrize("transform", [lambda f: f, jax.jit])
def test_a_fence_returns_the_same_arrays(tree, transform):
    again = transform(fence)(tree)
    assert jax.tree.structure(again) == jax.tree.structure(tree)
    for before, after in zip(jax.tree.leaves(tree), jax.tree.leaves(again), strict=True):
        assert before.dtype == after.dtype
        np.testing.assert_array_equal(before, after)


def test_a_fence_returns_the_same_arrays_in_a_vmap():
    tree = (jnp.arange(12.0).reshape(4, 3), jnp.arange(4.0))
    for before, after in zip(tree, jax.jit(jax.vmap(fence))(tree), strict=True):
        np.testing.assert_array_equal(before, after)
