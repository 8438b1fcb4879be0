"""Edges that know how boxes lie to each other, or what their classes share: features and forms."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.encoders import encoder, message_passing
from gril_jax.encoders.encoder import EncoderConfig
from gril_jax.errors import ConfigError
from gril_jax.graphs.scene import scene_graph

CONFIG = EncoderConfig(3, width=8, rounds=1, latent=4, relations=True)
CENTER = jnp.array([[0.0, 0.0], [0.1, 0.5], [-0.6, 0.2]])
SIZE = jnp.array([[0.8, 0.6], [0.2, 0.4], [0.3, 0.3]])


def _graph(center):
    none = jnp.zeros(3, bool)
    return scene_graph(center, SIZE, jnp.arange(3), none, none)


def test_relations_are_overhang_and_gap_of_plain_arithmetic():
    graph = _graph(CENTER)
    found = np.asarray(message_passing._relations(graph))
    for edge, (s, r) in enumerate(
        zip(graph.senders.tolist(), graph.receivers.tolist(), strict=True)
    ):
        away = np.abs(np.asarray(CENTER[s] - CENTER[r]))
        half_s, half_r = np.asarray(SIZE[s]) / 2, np.asarray(SIZE[r]) / 2
        expected = [*np.maximum(away + half_r - half_s, 0), *np.maximum(away - half_r - half_s, 0)]
        np.testing.assert_allclose(found[edge], expected, atol=1e-6)


def test_relations_are_four_numbers_of_an_edge():
    params = jax.eval_shape(lambda key: message_passing.init(key, CONFIG), jax.random.key(0))
    kernels = [x.shape for x in jax.tree.leaves(params["messages"])]
    assert (7, 8) in kernels  # offset, its length, and four relations


WORDS = (0, 0, 1, 2, 3, 2)  # robot, red star, blue star
ALIKE = EncoderConfig(3, width=8, rounds=1, latent=4, words=WORDS)


def test_edges_know_which_words_two_classes_share_and_nodes_know_no_class():
    graph = _graph(CENTER)
    found = np.asarray(message_passing._alike(graph, ALIKE))
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
