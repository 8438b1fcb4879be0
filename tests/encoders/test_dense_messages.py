"""Dense messages against a loop over pairs, and edges as a table."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.encoders.dense_messages import square_edges, sum_messages, thin_product
from gril_jax.errors import ShapeError
from gril_jax.graphs.scene import edge_indices


def _inputs(num_nodes, seed=0):
    rng = np.random.default_rng(seed)
    shapes = [(num_nodes, 6), (num_nodes, 6), (num_nodes * (num_nodes - 1), 3), (3, 6)]
    sent, received, edges, kernel = (jnp.asarray(rng.normal(size=s), jnp.float32) for s in shapes)
    return sent, received, jnp.asarray(rng.random(num_nodes) < 0.7), edges, kernel


@functools.partial(jax.jit, static_argnames="at_once")
def _summed(sent, received, audible, edges, kernel, at_once=None):
    table = square_edges(edges, len(audible))
    return sum_messages(
        sent, received, audible, table, lambda e: thin_product(e, kernel), at_once=at_once
    )


@pytest.mark.parametrize("num_nodes", [0, 1, 2, 3, 7])
def test_edges_become_a_table_by_receiver_and_sender(num_nodes):
    edges = _inputs(num_nodes)[3]
    table = np.asarray(square_edges(edges, num_nodes))
    for edge, sender, receiver in zip(edges, *edge_indices(num_nodes), strict=True):
        np.testing.assert_array_equal(table[receiver, sender], edge)
    assert (table[np.arange(num_nodes), np.arange(num_nodes)] == 0).all()


@pytest.mark.parametrize("num_nodes", [0, 1, 2, 17])
def test_sum_equals_the_loop_however_many_senders_at_once(num_nodes):
    inputs = _inputs(num_nodes)
    sent, received, audible, edges, kernel = (np.asarray(x, np.float64) for x in inputs)
    wanted = np.zeros((num_nodes, 6))
    for edge, j, i in zip(edges, *edge_indices(num_nodes), strict=True):
        wanted[i] += np.maximum(sent[j] + received[i] + edge @ kernel, 0) * audible[j]
    for at_once in (None, 2):
        got = _summed(*inputs, at_once=at_once)
        np.testing.assert_allclose(got, wanted, rtol=1e-4, atol=1e-5)


def test_edges_are_optional():
    sent, received, audible, edges, kernel = _inputs(4)
    with_nothing = _summed(sent, received, audible, 0 * edges, kernel)
    np.testing.assert_allclose(sum_messages(sent, received, audible), with_nothing, rtol=1e-6)


def test_thin_product_is_the_matrix_product_with_its_derivatives_both_ways():
    x, kernel = _inputs(4)[3:]

    def loss(product, x, kernel):
        return jnp.sum(jnp.sin(product(x, kernel)))

    np.testing.assert_allclose(thin_product(x, kernel), x @ kernel, rtol=1e-5, atol=1e-6)
    for derivative in (jax.grad, lambda f, n: jax.jacfwd(jax.grad(f, n), n)):
        for number in (1, 2):
            both = jax.jit(derivative(loss, number), static_argnums=0)
            ours, wanted = both(thin_product, x, kernel), both(jnp.matmul, x, kernel)
            np.testing.assert_allclose(ours, wanted, rtol=1e-4, atol=1e-5)


def test_an_incomplete_graph_is_refused_with_both_numbers():
    with pytest.raises(ShapeError, match=r"edges has shape \(5, 3\) but there are 3 nodes.* 6 "):
        square_edges(jnp.zeros((5, 3)), 3)
