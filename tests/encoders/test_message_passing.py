"""The paper's encoder in parts: dense messages against jraph, relations of edges, pooling."""

import dataclasses
import functools
import json

import jax
import jax.numpy as jnp
import jraph
import numpy as np
import pytest
from flax import linen as nn
from support.graph_frames import random_frame

from gril_jax.encoders import encoder, graph_features, message_passing
from gril_jax.encoders.dense_messages import square_edges, sum_messages, thin_product
from gril_jax.encoders.encoder import EncoderConfig
from gril_jax.encoders.message_passing import node_weights, weighted_pool
from gril_jax.errors import ConfigError, ShapeError
from gril_jax.graphs.scene import edge_indices, scene_graph
from gril_jax.pretraining.edges import WIDTH

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
        edges = [jnp.concatenate([graph.edges, graph_features.relations(graph)], -1) / unit]
        edges.append(graph_features.side_of_edge(graph))
    if config.words:
        edges.append(graph_features.alike(graph, config))
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


RELATED = EncoderConfig(3, width=8, rounds=1, latent=4, relations=True)
CENTER = jnp.array([[0.0, 0.0], [0.1, 0.5], [-0.6, 0.2]])
SIZE = jnp.array([[0.8, 0.6], [0.2, 0.4], [0.3, 0.3]])


def _graph(center):
    none = jnp.zeros(3, bool)
    return scene_graph(center, SIZE, jnp.arange(3), none, none)


def test_relations_are_overhang_and_gap_of_plain_arithmetic():
    graph = _graph(CENTER)
    found = np.asarray(graph_features.relations(graph))
    for edge, (s, r) in enumerate(
        zip(graph.senders.tolist(), graph.receivers.tolist(), strict=True)
    ):
        away = np.abs(np.asarray(CENTER[s] - CENTER[r]))
        half_s, half_r = np.asarray(SIZE[s]) / 2, np.asarray(SIZE[r]) / 2
        expected = [*np.maximum(away + half_r - half_s, 0), *np.maximum(away - half_r - half_s, 0)]
        np.testing.assert_allclose(found[edge], expected, atol=1e-6)


def test_the_side_of_an_edge_changes_where_a_centre_crosses_it():
    found = np.asarray(graph_features.side_of_edge(_graph(CENTER)))[:, 0]
    graph = _graph(CENTER)
    for edge, (s, r) in enumerate(
        zip(graph.senders.tolist(), graph.receivers.tolist(), strict=True)
    ):
        beyond = (np.abs(CENTER[s] - CENTER[r]) - SIZE[s] / 2).max()
        half = float(SIZE[r].min()) / 2
        assert found[edge] == pytest.approx(np.tanh(beyond / (2 * WIDTH * half)), abs=1e-5)


def test_relations_are_five_numbers_of_an_edge():
    params = jax.eval_shape(lambda key: message_passing.init(key, RELATED), jax.random.key(0))
    kernels = [x.shape for x in jax.tree.leaves(params["messages"])]
    assert (8, 8) in kernels  # offset, its length, and five relations


WORDS = (0, 0, 1, 2, 3, 2)  # robot, red star, blue star
ALIKE = EncoderConfig(3, width=8, rounds=1, latent=4, words=WORDS)


def test_edges_know_which_words_two_classes_share_and_nodes_know_no_class():
    graph = _graph(CENTER)
    found = np.asarray(graph_features.alike(graph, ALIKE))
    pairs = list(zip(graph.senders.tolist(), graph.receivers.tolist(), strict=True))
    assert found[pairs.index((1, 2))].tolist() == [0, 1]  # both stars, of two colours
    assert found[pairs.index((0, 1))].tolist() == [0, 0]


def test_a_latent_is_the_same_in_other_colours_and_another_where_two_become_alike():
    config = EncoderConfig(5, width=8, rounds=1, latent=4, words=(0, 0, 1, 2, 3, 2, 3, 4, 1, 4))
    params, none = encoder.init(jax.random.key(0), config), jnp.zeros(3, bool)

    def latent(label):
        graph = scene_graph(CENTER, SIZE, jnp.array(label), none, none)
        return np.asarray(encoder.apply(params, graph, config))

    robot, red_star, blue_star, blue_square, red_square = range(5)
    first = latent([robot, red_star, blue_square])
    np.testing.assert_array_equal(first, latent([robot, blue_star, red_square]))
    assert np.abs(first - latent([robot, blue_star, blue_square])).max() > 1e-3


def test_words_of_another_number_of_classes_are_refused_and_come_back_from_a_file():
    with pytest.raises(ConfigError, match=r"encoder\.words has 3 entries"):
        EncoderConfig(3, words=(0, 1, 2))
    saved = json.loads(json.dumps(encoder.to_json(ALIKE)))
    assert encoder.from_json(saved) == ALIKE
    for wrong in ([0.5] * 6, "abcdef", [[0, 1]] * 3):
        with pytest.raises(ConfigError, match=r"encoder\.words is"):
            encoder.from_json(saved | {"words": wrong})


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


PAIRS = EncoderConfig(3, width=8, rounds=0, latent=4, words=WORDS, pair_statistics=True)


def test_statistics_of_pairs_are_those_of_objects_without_the_robot_and_padding():
    none = jnp.zeros(3, bool)
    robot, present = jnp.array([True, False, False]), jnp.array([True, True, True])

    @jax.jit
    def pairs(present):
        graph = scene_graph(CENTER, SIZE, jnp.arange(3), robot, none, present)
        return graph_features.of_pairs(graph, PAIRS)

    found = np.asarray(pairs(present)).reshape(5, -1)
    apart = np.linalg.norm(CENTER[1] - CENTER[2])
    words = [True, False, True, True, False]  # all; one colour or not; one shape or not
    np.testing.assert_allclose(found[:, 0], np.where(words, apart, 0.0), atol=1e-5)
    np.testing.assert_allclose(pairs(present.at[2].set(False)), 0.0, atol=1e-5)


def test_pooled_nodes_do_not_tell_two_pairs_from_a_cross_but_statistics_of_pairs_do():
    config = dataclasses.replace(PAIRS, num_classes=2, words=(0, 1, 2, 1))
    square = jnp.array([[0.0, 0.0], [0.1, 0.0], [0.0, 0.1], [0.1, 0.1]])
    none, size = jnp.zeros(4, bool), jnp.full((4, 2), 0.1)

    def latents(config):
        def one(label):
            return encoder.apply(params, scene_graph(square, size, label, none, none), config)

        params = encoder.init(jax.random.key(0), config)
        return np.asarray(jax.jit(jax.vmap(one))(jnp.array([[0, 0, 1, 1], [0, 1, 1, 0]])))

    rows, cross = latents(dataclasses.replace(config, pair_statistics=False))
    np.testing.assert_allclose(rows, cross, atol=1e-6)
    rows, cross = latents(config)
    assert np.abs(rows - cross).max() > 1e-3
