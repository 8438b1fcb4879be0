"""Scene graphs against a plain double loop, and the gradient where two centres coincide."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.graphs.scene import edge_indices, safe_norm, scene_graph


def _frame(num_nodes, seed=0):
    rng = np.random.default_rng(seed)
    return (
        jnp.asarray(rng.normal(size=(num_nodes, 2)), jnp.float32),
        jnp.asarray(rng.uniform(0.1, 1, (num_nodes, 2)), jnp.float32),
        jnp.arange(num_nodes),
        jnp.arange(num_nodes) == 1,
        jnp.arange(num_nodes) == 2,
    )


@pytest.mark.parametrize("num_nodes", [1, 2, 5])
def test_edges_are_receiver_major_without_self_edges(num_nodes):
    pairs = [(s, r) for r in range(num_nodes) for s in range(num_nodes) if s != r]
    senders, receivers = edge_indices(num_nodes)
    assert list(zip(senders.tolist(), receivers.tolist(), strict=True)) == pairs


def test_edge_features_are_offset_from_receiver_to_sender_and_its_length():
    frame = _frame(4)
    graph = scene_graph(*frame)
    center = np.asarray(frame[0], np.float64)
    expected = []
    for receiver in range(4):
        for sender in range(4):
            if sender != receiver:
                x, y = center[sender] - center[receiver]
                expected.append([x, y, (x * x + y * y) ** 0.5])
    np.testing.assert_allclose(graph.edges, expected, rtol=1e-6)
    assert graph.n_node.tolist() == [4]
    assert graph.n_edge.tolist() == [12]


def test_nodes_carry_the_frame_and_all_are_present_by_default():
    frame = _frame(3)
    nodes = scene_graph(*frame).nodes
    for field, value in zip(("center", "size", "label", "is_robot", "active"), frame, strict=True):
        np.testing.assert_array_equal(getattr(nodes, field), value)
    assert nodes.present.tolist() == [True] * 3
    gone = frame[1].at[1].set(0.0)  # a box without a size
    assert scene_graph(frame[0], gone, *frame[2:]).nodes.present.tolist() == [True, False, True]
    present = jnp.array([True, False, True])
    assert scene_graph(*frame, present).nodes.present.tolist() == present.tolist()


def test_one_object_makes_a_graph_without_edges():
    graph = scene_graph(*_frame(1))
    assert graph.edges.shape == (0, 3)
    assert graph.senders.shape == (0,)


def test_gradient_of_distance_is_finite_where_centres_coincide():
    center, *rest = _frame(3)
    center = center.at[1].set(center[0])
    gradient = jax.grad(lambda c: scene_graph(c, *rest).edges.sum())(center)
    assert np.isfinite(gradient).all()


def test_safe_norm_is_the_norm_and_has_its_gradient_away_from_zero():
    x = jnp.array([[3.0, 4.0], [0.0, 0.0], [1e-8, 0.0]])
    np.testing.assert_allclose(safe_norm(x), [5.0, 0.0, 1e-8], rtol=1e-6)
    gradient = jax.grad(lambda x: safe_norm(x).sum())(x)
    np.testing.assert_allclose(gradient, [[0.6, 0.8], [0.0, 0.0], [1.0, 0.0]], rtol=1e-6)


def test_vmap_equals_a_loop_and_jit_equals_plain():
    frames = [_frame(4, seed) for seed in range(3)]
    batch = jax.tree.map(lambda *x: jnp.stack(x), *frames)
    batched = jax.jit(jax.vmap(scene_graph))(*batch)
    for i, frame in enumerate(frames):
        np.testing.assert_allclose(batched.edges[i], scene_graph(*frame).edges, rtol=1e-6)


def test_the_length_of_a_vector_with_nan_is_nan():
    """Were it 0, a broken encoder would be paid as if at the goal."""
    found = np.asarray(safe_norm(jnp.array([[jnp.nan, 0.0], [3.0, 4.0]])))
    assert np.isnan(found[0])
    assert found[1] == 5.0
