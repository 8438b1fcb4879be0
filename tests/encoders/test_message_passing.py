"""The dense forms of message passing against jraph, and what is relied on in the parameters."""

import dataclasses

import jax
import jax.numpy as jnp
import jraph
import numpy as np
import pytest
from flax import linen as nn
from support.graph_frames import random_frame

from gril_jax.encoders import message_passing
from gril_jax.encoders.encoder import EncoderConfig
from gril_jax.errors import ShapeError
from gril_jax.graphs.scene import scene_graph

CONFIG = EncoderConfig(num_classes=4, width=8, rounds=2, latent=5, length_unit=0.5)
WITH_RELATIONS = dataclasses.replace(CONFIG, relations=True, words=(0, 0, 1, 2, 3, 2, 3, 4))


def _embed(params, graph, config, form):
    return message_passing.node_embeddings(params, graph, config, form=form)


def _by_jraph(params, graph, config):
    """Messages gathered by the graph's own indices and summed by scatter."""
    p, nodes, unit = params["messages"], graph.nodes, config.length_unit

    def dense(number, x):
        layer = p[f"Dense_{number}"]
        return x @ layer["kernel"] + layer.get("bias", 0.0)

    edges = [graph.edges / unit]
    if config.relations:
        edges = [jnp.concatenate([graph.edges, message_passing._relations(graph)], -1) / unit]
    if config.words:
        edges.append(message_passing._alike(graph, config))
    kinds = [] if config.words else [jax.nn.one_hot(nodes.label, config.num_classes)]
    z = dense(0, jnp.concatenate([*kinds, nodes.center / unit, nodes.size / unit], -1))
    audible = nodes.present if config.robot_messages else nodes.present & ~nodes.is_robot
    graph = graph._replace(edges=jnp.concatenate(edges, -1))
    for first in range(1, 1 + 5 * config.rounds, 5):

        def message(edge, sender, receiver, _, first=first):
            sent = dense(first, sender["z"]) + dense(first + 1, receiver["z"])
            return nn.relu(sent + dense(first + 2, edge)) * sender["audible"][:, None]

        network = jraph.GraphNetwork(message, lambda _, __, received, ___: received)
        received = network(graph._replace(nodes={"z": z, "audible": audible})).nodes
        hidden = nn.relu(dense(first + 3, jnp.concatenate([z, received], -1)))
        z = z + dense(first + 4, hidden)
    return z


@pytest.mark.parametrize("config", [CONFIG, WITH_RELATIONS], ids=["plain", "relations and words"])
@pytest.mark.parametrize("num_nodes", [0, 1, 7])
def test_both_forms_give_the_numbers_and_gradients_of_jraph(num_nodes, config):
    params = jax.jit(message_passing.init)(jax.random.key(0), config)
    frame = random_frame(1, num_nodes)

    @jax.jit
    def derived(params, center):
        def summed(params, center, embed):
            nodes = embed(params, scene_graph(**frame | {"center": center}), config)
            return jnp.sum(jnp.sin(nodes)), nodes

        forms = [lambda *x, f=f: _embed(*x, f) for f in message_passing.Form.__args__]
        both = jax.grad(summed, (0, 1), has_aux=True)
        return [both(params, center, embed) for embed in (_by_jraph, *forms)]

    wanted, *found = derived(params, frame["center"])
    assert len(found) == 2
    for got in found:
        for a, b in zip(jax.tree.leaves(got), jax.tree.leaves(wanted), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-5)


def test_a_graph_that_is_not_complete_is_refused():
    graph = scene_graph(**random_frame())
    params = message_passing.init(jax.random.key(0), CONFIG)
    with pytest.raises(ShapeError, match=r"edges has shape \(19, 3\) but there are 5 nodes"):
        _embed(params, graph._replace(edges=graph.edges[1:]), CONFIG, "dense")


def test_names_in_the_parameters_are_those_of_saved_rewards():
    params = jax.eval_shape(lambda key: message_passing.init(key, CONFIG), jax.random.key(0))
    shapes = {k: v["kernel"].shape for k, v in params["messages"].items()}
    one_round = [(8, 8), (8, 8), (3, 8), (16, 8), (8, 8)]
    assert shapes == {f"Dense_{i}": s for i, s in enumerate([(8, 8), *one_round, *one_round])}
    without_bias = {k for k, v in params["messages"].items() if "bias" not in v}
    assert without_bias == {"Dense_1", "Dense_3", "Dense_6", "Dense_8"}
