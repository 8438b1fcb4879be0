"""Vectors of the plane against complex numbers; `fence` changes nothing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.planar import plane
from gril_jax.envs.planar.plane import Vec, fence, heading
from hypothesis import given, settings
from hypothesis import strategies as st

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
