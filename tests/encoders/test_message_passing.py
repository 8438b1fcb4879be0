"""The dense form of message passing against jraph's: graph by graph, and many graphs as one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.graph_frames import random_frame

from gril_jax.encoders import message_passing
from gril_jax.encoders.encoder import EncoderConfig
from gril_jax.errors import ShapeError
from gril_jax.graphs.scene import edge_indices, scene_graph

CONFIG = EncoderConfig(num_classes=4, width=8, rounds=2, latent=5, length_unit=0.5)
PARAMS = jax.jit(message_passing.init)(jax.random.key(0), CONFIG)


def _embed(graph, form, params=PARAMS):
    return message_passing.node_embeddings(params, graph, CONFIG, form=form)


@pytest.mark.parametrize("num_nodes", [0, 1, 7])
def test_all_forms_give_the_same_numbers_and_gradients(num_nodes):
    graph = scene_graph(**random_frame(1, num_nodes))

    def summed(params, graph_edges, form):
        nodes = _embed(graph._replace(edges=graph_edges), form, params)
        return jnp.sum(jnp.sin(nodes)), nodes

    derived = jax.jit(jax.grad(summed, (0, 1), has_aux=True), static_argnums=2)
    wanted = derived(PARAMS, graph.edges, "jraph")
    for form in ("dense", "square"):
        got = derived(PARAMS, graph.edges, form)
        for a, b in zip(jax.tree.leaves(got), jax.tree.leaves(wanted), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-5)


def _block_diagonal(graphs):
    """One graph that holds the graphs of a batch side by side."""
    num_graphs, num_nodes = graphs.nodes.label.shape
    senders, receivers = edge_indices(num_nodes)
    first = num_nodes * jnp.arange(num_graphs)[:, None]
    return graphs._replace(
        nodes=jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), graphs.nodes),
        edges=graphs.edges.reshape(-1, graphs.edges.shape[-1]),
        senders=(first + senders).reshape(-1),
        receivers=(first + receivers).reshape(-1),
        n_node=graphs.n_node.reshape(-1),
        n_edge=graphs.n_edge.reshape(-1),
    )


def test_many_graphs_as_one_block_diagonal_equal_each_on_its_own():
    frames = [random_frame(seed) for seed in range(3)]
    graphs = jax.vmap(lambda f: scene_graph(**f))(jax.tree.map(lambda *x: jnp.stack(x), *frames))
    as_one = jax.jit(lambda g: _embed(_block_diagonal(g), "jraph"))(graphs).reshape(3, 5, -1)
    alone = jax.jit(jax.vmap(lambda g: _embed(g, "dense")))(graphs)
    np.testing.assert_allclose(as_one, alone, rtol=1e-4, atol=1e-5)


def test_the_dense_forms_refuse_a_graph_that_is_not_complete():
    graph = scene_graph(**random_frame())
    with pytest.raises(ShapeError, match=r"edges has shape \(19, 3\) but there are 5 nodes"):
        _embed(graph._replace(edges=graph.edges[1:]), "dense")


def test_forward_derivatives_exist():
    frame = random_frame()

    def summed(center):
        return jnp.sum(jnp.square(_embed(scene_graph(**frame | {"center": center}), "dense")))

    forward, backward = jax.jit(lambda x: (jax.jacfwd(summed)(x), jax.grad(summed)(x)))(
        frame["center"]
    )
    np.testing.assert_allclose(forward, backward, rtol=1e-3, atol=1e-4)


def test_names_in_the_parameters_are_those_of_saved_rewards():
    shapes = {k: v["kernel"].shape for k, v in PARAMS["messages"].items()}
    one_round = [(8, 8), (8, 8), (3, 8), (16, 8), (8, 8)]
    assert shapes == {f"Dense_{i}": s for i, s in enumerate([(8, 8), *one_round, *one_round])}
    without_bias = {k for k, v in PARAMS["messages"].items() if "bias" not in v}
    assert without_bias == {"Dense_1", "Dense_3", "Dense_6", "Dense_8"}
