"""Reconstruction against a plain loop of Eq. 5, with padding and units."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.encoders.encoder import EncoderConfig
from gril_jax.errors import ConfigError
from gril_jax.losses import decode, decode_graph, reconstruction
from gril_jax.losses.reconstruction import init, init_graph
from gril_jax.types import Nodes

RNG = np.random.default_rng(0)
NODES = Nodes(
    center=jnp.asarray(RNG.normal(size=(4, 2)), jnp.float32),
    size=jnp.asarray(RNG.uniform(size=(4, 2)), jnp.float32),
    label=jnp.array([2, 0, 1, 1]),
    active=jnp.zeros(4, bool),
    is_robot=jnp.zeros(4, bool),
    present=jnp.array([True, True, True, False]),
)
BOX = jnp.asarray(RNG.normal(size=(4, 4)), jnp.float32)
LOGITS = jnp.asarray(RNG.normal(size=(4, 3)), jnp.float32)


def test_values_equal_the_loop_and_padding_is_zero():
    expected = []
    for i in range(4):
        truth = [*np.asarray(NODES.center[i]), *np.asarray(NODES.size[i])]
        box_error = sum((float(b) - t) ** 2 for b, t in zip(BOX[i], truth, strict=True)) / 4
        scores = np.exp(np.asarray(LOGITS[i], np.float64))
        class_error = -np.log(scores[int(NODES.label[i])] / scores.sum())
        expected.append((box_error + class_error) * bool(NODES.present[i]))
    np.testing.assert_allclose(reconstruction(BOX, LOGITS, NODES), expected, rtol=1e-5)


def test_exact_boxes_and_certain_classes_cost_nothing():
    box = jnp.concatenate([NODES.center, NODES.size], axis=1)
    logits = 100.0 * jax.nn.one_hot(NODES.label, 3)
    np.testing.assert_allclose(reconstruction(box, logits, NODES), 0.0, atol=1e-6)


def test_box_errors_count_in_the_given_unit():
    nodes = NODES._replace(present=jnp.ones(4, bool))
    certain = 100.0 * jax.nn.one_hot(NODES.label, 3)
    metres = reconstruction(BOX, certain, nodes)
    halves = reconstruction(BOX, certain, nodes, length_unit=0.5)
    np.testing.assert_allclose(halves, 4 * metres, rtol=1e-5)


def test_nan_in_padding_reaches_neither_value_nor_gradient():
    nodes = NODES._replace(center=NODES.center.at[3].set(jnp.nan))
    value, gradient = jax.value_and_grad(lambda b: reconstruction(b, LOGITS, nodes).sum())(BOX)
    assert np.isfinite(value)
    assert np.isfinite(gradient[:3]).all()


def test_gradient_equals_finite_differences():
    def value(t):
        return reconstruction(BOX + t, LOGITS + t * BOX[:, :3], NODES).sum()

    numeric = (value(1e-2) - value(-1e-2)) / 2e-2
    np.testing.assert_allclose(jax.grad(value)(0.0), numeric, rtol=1e-2)


def test_decoder_sees_one_node_at_a_time_and_gives_boxes_and_logits():
    config = EncoderConfig(num_classes=3, width=8)
    params = jax.jit(init)(jax.random.key(0), config)
    embeddings = jnp.asarray(RNG.normal(size=(4, 8)), jnp.float32)
    box, logits = decode(params, embeddings, config)
    assert box.shape == (4, 4)
    assert logits.shape == (4, 3)
    alone = decode(params, embeddings[2:3], config)
    np.testing.assert_allclose(alone[0], box[2:3], rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(alone[1], logits[2:3], rtol=1e-5, atol=1e-6)


def test_padding_has_no_gradient_and_an_unknown_label_no_class_error():
    nodes = NODES._replace(center=NODES.center.at[3].set(jnp.nan), label=jnp.array([2, 7, -1, 1]))
    gradient = jax.grad(lambda b, x: reconstruction(b, x, nodes).sum(), argnums=(0, 1))(BOX, LOGITS)
    assert all((np.asarray(g[3]) == 0).all() for g in gradient)
    box_alone = jnp.square(BOX - jnp.concatenate([nodes.center, nodes.size], 1)).mean(axis=1)
    found = reconstruction(BOX, LOGITS, nodes)
    np.testing.assert_allclose(found[1:3], box_alone[1:3], rtol=1e-5)
    assert found[3] == 0


def test_graph_decoder_gives_every_node_from_one_vector():
    config = EncoderConfig(num_classes=3, width=8, latent=5, length_unit=2.0)
    params = jax.jit(functools.partial(init_graph, config=config, num_nodes=4))(jax.random.key(0))
    vector = jnp.asarray(RNG.normal(size=5), jnp.float32)
    box, logits = decode_graph(params, vector, config, num_nodes=4)
    hidden = np.maximum(vector @ params["Dense_0"]["kernel"] + params["Dense_0"]["bias"], 0)
    out = (hidden @ params["Dense_1"]["kernel"] + params["Dense_1"]["bias"]).reshape(4, 7)
    np.testing.assert_allclose(box, 2.0 * out[:, :4], rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(logits, out[:, 4:], rtol=1e-5, atol=1e-6)
    assert np.isfinite(reconstruction(box, logits, NODES)).all()


def test_graph_decoder_learns_the_boxes_of_frames_from_their_vectors():
    config = EncoderConfig(num_classes=3, width=32, latent=6)
    params = init_graph(jax.random.key(0), config, num_nodes=4)
    vectors = jnp.asarray(RNG.normal(size=(8, 6)), jnp.float32)
    centers = jnp.tanh(vectors @ jnp.asarray(RNG.normal(size=(6, 8)), jnp.float32)).reshape(8, 4, 2)

    def loss(params):
        def one(vector, center):
            box, logits = decode_graph(params, vector, config, num_nodes=4)
            return reconstruction(box, logits, NODES._replace(center=center)).mean()

        return jax.vmap(one)(vectors, centers).mean()

    @jax.jit
    def descend(params):
        def update(params, _):
            value, gradient = jax.value_and_grad(loss)(params)
            return jax.tree.map(lambda p, g: p - 0.3 * g, params, gradient), value

        return jax.lax.scan(update, params, length=200)[1]

    values = descend(params)
    assert values[-1] < 0.2 * values[0]


def test_what_does_not_fit_is_named():
    with pytest.raises(ConfigError, match=r"length_unit is 0.0; it must be positive"):
        reconstruction(BOX, LOGITS, NODES, length_unit=0.0)
    with pytest.raises(ConfigError, match="num_nodes is 0"):
        init_graph(jax.random.key(0), EncoderConfig(num_classes=3), num_nodes=0)
