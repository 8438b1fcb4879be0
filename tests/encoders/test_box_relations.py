"""Edges that know how boxes lie to each other: the features, and that all forms agree with them."""

import jax
import jax.numpy as jnp
import numpy as np

from gril_jax.encoders import message_passing
from gril_jax.encoders.encoder import EncoderConfig
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


def test_the_dense_and_the_jraph_form_agree_and_relations_count():
    params = message_passing.init(jax.random.key(0), CONFIG)
    dense = message_passing.node_embeddings(params, _graph(CENTER), CONFIG)
    for form in ("square", "jraph"):
        other = message_passing.node_embeddings(params, _graph(CENTER), CONFIG, form=form)
        np.testing.assert_allclose(dense, other, atol=1e-5)
    kernels = [x.shape for x in jax.tree.leaves(params["messages"])]
    assert (7, 8) in kernels  # offset, its length, and four relations
