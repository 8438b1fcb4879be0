"""Weighted pooling against Eqs. 2 and 3 as a plain loop, and at its edges."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.encoders.message_passing import node_weights, weighted_pool

ACTIVE = jnp.array([True, False, True, False, True])
ROBOT = jnp.array([False, False, False, True, True])
PRESENT = jnp.array([True, True, False, True, True])


@pytest.mark.parametrize("alpha", [1.0, 5.0])
def test_weights_equal_the_papers_product(alpha):
    expected = [
        (1 + (alpha - 1) * bool(a)) * (1 - bool(r)) for a, r in zip(ACTIVE, ROBOT, strict=True)
    ]
    np.testing.assert_allclose(node_weights(ACTIVE, ROBOT, alpha=alpha), expected)


def test_padding_weighs_nothing_and_the_robot_counts_only_on_request():
    assert node_weights(ACTIVE, ROBOT, PRESENT, alpha=3.0).tolist() == [3, 1, 0, 0, 0]
    pooled = node_weights(ACTIVE, ROBOT, PRESENT, alpha=3.0, pool_robot=True)
    assert pooled.tolist() == [3, 1, 0, 1, 3]


def test_pool_equals_a_loop_in_float64():
    rng = np.random.default_rng(0)
    z, weights = rng.normal(size=(6, 3)), rng.uniform(size=6)
    expected = sum(w * row for w, row in zip(weights, z, strict=True)) / sum(weights)
    pooled = weighted_pool(jnp.asarray(z, jnp.float32), jnp.asarray(weights, jnp.float32))
    np.testing.assert_allclose(pooled, expected, rtol=1e-5)


def test_robot_only_frame_pools_to_zero_with_zero_gradient():
    weights = node_weights(jnp.array([True]), jnp.array([True]))
    z = jnp.array([[2.0, -3.0]])
    assert weighted_pool(z, weights).tolist() == [0.0, 0.0]
    gradient = jax.grad(lambda z: weighted_pool(z, weights).sum())(z)
    assert gradient.tolist() == [[0.0, 0.0]]


def test_pool_ignores_node_order_and_the_scale_of_the_weights():
    rng = np.random.default_rng(1)
    z = jnp.asarray(rng.normal(size=(5, 4)), jnp.float32)
    weights = jnp.asarray(rng.uniform(size=5), jnp.float32)
    order = jnp.array([3, 1, 4, 0, 2])
    expected = weighted_pool(z, weights)
    np.testing.assert_allclose(weighted_pool(z[order], weights[order]), expected, atol=1e-6)
    np.testing.assert_allclose(weighted_pool(z, 7 * weights), expected, atol=1e-6)


def test_gradient_equals_finite_differences_in_alpha():
    z = jnp.arange(10.0).reshape(5, 2) ** 2

    def first(alpha):
        return weighted_pool(z, node_weights(ACTIVE, ROBOT, alpha=alpha))[0]

    numeric = (first(5.1) - first(4.9)) / 0.2
    np.testing.assert_allclose(jax.grad(first)(5.0), numeric, rtol=1e-2)
    assert abs(numeric) > 0.05
