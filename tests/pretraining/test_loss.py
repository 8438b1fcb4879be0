"""The loss of encoder training: every switch, against the losses it is made of."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.kinematic_demos import kinematic_demos

from gril_jax import losses as library
from gril_jax.config.tables import ALIGNMENTS
from gril_jax.encoders.encoder import EncoderConfig, InteractionConfig, MLPConfig
from gril_jax.errors import ConfigError
from gril_jax.pretraining import loss, pretrain
from gril_jax.pretraining.pretrain import Hyper, Static

SMALL = Static(
    encoder=EncoderConfig(num_classes=7, width=8, rounds=1, latent=4), num_videos=3, num_frames=6
)


terms_of, latents_of = jax.jit(loss.terms), jax.jit(loss.latents)
mean_consistency = jax.jit(library.mean_consistency)


@pytest.fixture(scope="module")
def demos():
    return jax.tree.map(jnp.asarray, kinematic_demos(0, 5, num_objects=5))


def _terms(config, demos, hyper=Hyper()):  # noqa: B008 -- a tuple of numbers
    """Terms of some frames of three videos, and what they come from."""
    some = jax.tree.map(lambda x: x[:3], demos)
    params = pretrain.init(jax.random.key(0), demos, config).params
    active = np.zeros((*some.center.shape[:3],), bool)
    frames = np.tile(5 * np.arange(6), (3, 1))
    valid = np.arange(6) < np.array([[6], [4], [6]])
    terms = terms_of(*params, jax.random.key(1), some, active, frames, valid, hyper, config)
    some = jax.tree.map(np.asarray, some)
    found = [
        latents_of(params.encoder, demo, bits, rows, hyper, config)
        for demo, bits, rows in zip(
            [jax.tree.map(lambda x, i=i: x[i], some) for i in range(3)], active, frames, strict=True
        )
    ]
    times = (frames / some.length[:, None]).astype(np.float32)
    return terms, jax.tree.map(np.asarray, found), times, valid, params


@jax.jit
def _node_errors(decoder, embeddings, nodes):
    box, logits = library.decode(decoder, embeddings, SMALL.encoder)
    return library.reconstruction(box, logits, nodes)


@jax.jit
def _graph_errors(decoder, latent, nodes):
    box, logits = library.decode_graph(decoder, latent, SMALL.encoder, num_nodes=5)
    return library.reconstruction(box, logits, nodes)


def test_the_terms_are_the_librarys_losses_of_the_latents(demos):
    terms, found, times, valid, params = _terms(SMALL, demos)
    latents = np.stack([f[0] for f in found])
    cycle, agreement = mean_consistency(latents, times, valid)
    np.testing.assert_allclose(terms.consistency, cycle, rtol=1e-4)
    np.testing.assert_allclose(terms.agreement, agreement, rtol=1e-4)
    errors = []
    for (_, embeddings, nodes), ok in zip(found, valid, strict=True):
        for t in np.flatnonzero(ok):
            frame = jax.tree.map(lambda x, t=t: x[t], nodes)
            errors.append(_node_errors(params.decoder, embeddings[t], frame))
    np.testing.assert_allclose(terms.reconstruction, np.mean(errors), rtol=1e-4)


def test_soft_dtw_is_the_mean_divergence_a_frame_of_all_pairs(demos):
    config = dataclasses.replace(SMALL, consistency="soft_dtw")
    hyper = Hyper(soft_dtw_weight=2.0, gamma=0.5)
    terms, found, _, valid, _ = _terms(config, demos, hyper)
    latents, lengths = np.stack([f[0] for f in found]), valid.sum(axis=1)
    i, j = [0, 0, 1], [1, 2, 2]
    apart = jax.jit(lambda *pairs: library.soft_dtw_divergence(*pairs, gamma=0.5))
    each = apart(latents[i], latents[j], lengths[i], lengths[j]) / (lengths[i] + lengths[j])
    np.testing.assert_allclose(terms.consistency, 2.0 * np.mean(each), rtol=1e-3)


def test_the_graph_decoder_rebuilds_all_objects_but_the_robot_from_the_latent(demos):
    config = dataclasses.replace(SMALL, decoder="graph")
    terms, found, _, valid, params = _terms(config, demos)
    errors = []
    for (latents, _, nodes), ok in zip(found, valid, strict=True):
        for t in np.flatnonzero(ok):
            frame = jax.tree.map(lambda x, t=t: x[t], nodes)
            error = np.asarray(_graph_errors(params.decoder, latents[t], frame))
            errors.append(error[~np.asarray(demos.is_robot[0])])
    np.testing.assert_allclose(terms.reconstruction, np.mean(errors), rtol=1e-4)


@pytest.mark.parametrize(
    "kind", [InteractionConfig(num_classes=7, width=8), MLPConfig(num_classes=7, width=8)]
)
def test_every_graph_encoder_can_be_trained(demos, kind):
    config = dataclasses.replace(SMALL, encoder=kind, decoder="graph", updates=2)
    state, metrics = pretrain.step(
        pretrain.init(jax.random.key(0), demos, config), demos, Hyper(), config
    )
    assert np.isfinite(metrics.loss).all()
    values = pretrain.evaluate(state.params.encoder, demos, demos, Hyper(), config)
    np.testing.assert_allclose(values["reward_first"], -1.0, rtol=1e-3)


def test_an_encoder_without_nodes_has_none_to_decode():
    with pytest.raises(ConfigError, match="MLPConfig encoder has no nodes to decode"):
        Static(encoder=MLPConfig(num_classes=7))


def test_every_switch_changes_the_loss_and_nothing_is_nan(demos):
    """Losses are compared as they are; one step with the least usual switches goes through all."""
    some = jax.tree.map(lambda x: x[:3], demos)
    params = pretrain.init(jax.random.key(0), demos, SMALL).params
    active = np.zeros(some.center.shape[:3], bool)
    frames, valid = np.tile(5 * np.arange(6), (3, 1)), np.ones((3, 6), bool)
    stages = jnp.tile(jnp.linspace(0, 1, some.center.shape[1]), (3, 1))
    methods = {name: loss.heads.of(name) for name, one in ALIGNMENTS.items() if one.head}
    made = {
        name: one.init(jax.random.key(2), SMALL.encoder.latent) for name, one in methods.items()
    }

    @jax.jit  # one program, for they share all but the losses
    def consistencies(encoder, decoder, _, *inputs):
        found = []
        for name in ALIGNMENTS:
            config = dataclasses.replace(SMALL, consistency=name)
            given = encoder, decoder, made.get(name), *inputs, Hyper(), config, stages
            found.append(loss.terms(*given).consistency)
        return jnp.stack(found)

    found = consistencies(*params, jax.random.key(1), some, active, frames, valid)
    assert np.isfinite(found).all()
    assert len(set(found.tolist())) == len(ALIGNMENTS)

    rare = {"decoder": "graph", "consistency": "both", "updates": 1, "rewind": 0.5}
    config = dataclasses.replace(SMALL, **rare, turn_scenes=True, random_activity=0.5)
    state = pretrain.init(jax.random.key(0), demos, config)
    after, metrics = pretrain.step(state, demos, Hyper(), config)
    assert all(np.isfinite(x).all() for x in metrics)
    assert all(np.isfinite(x).all() for x in jax.tree.leaves(after.params))


def test_a_head_is_trained_with_the_encoder_and_is_the_reward(demos):
    config = dataclasses.replace(SMALL, consistency="sarm", updates=3, rewind=1.0)
    state = pretrain.init(jax.random.key(0), demos, config)
    after, metrics = pretrain.step(state, demos, Hyper(), config)
    assert np.isfinite(metrics.loss).all()
    changed = jax.tree.map(lambda a, b: bool((a != b).any()), state.params.head, after.params.head)
    assert changed == type(changed)(True, True, True, True, proportions=False)
    params = after.params
    values = pretrain.evaluate(params.encoder, demos, demos, Hyper(), config, params.head)
    np.testing.assert_allclose(values["reward_first"], -1.0, rtol=1e-3)


def test_a_method_without_its_head_is_refused():
    config = dataclasses.replace(SMALL, consistency="sarm")
    latents, times = jnp.zeros((2, 3, 4)), jnp.zeros((2, 3))
    with pytest.raises(ConfigError, match="consistency is 'sarm', which needs a head"):
        loss.aligned(jax.random.key(0), latents, times, times == 0, Hyper(), config)


def test_distances_are_not_taught_to_a_head(demos):
    config = dataclasses.replace(SMALL, consistency="rewind", num_perturbations=1)
    state = pretrain.init(jax.random.key(0), demos, config)
    with pytest.raises(ConfigError, match="consistency is 'rewind', whose reward is no distance"):
        pretrain.step(state, demos, Hyper(), config)


def test_what_has_moved_by_then_counts_as_moved_where_a_video_is_played_backwards(demos):
    demo = jax.tree.map(lambda x: x[0], demos)
    active = np.zeros(demo.center.shape[:2], bool)
    active[10:, 2] = True
    params = pretrain.init(jax.random.key(0), demos, SMALL).params.encoder
    frames = jnp.array([0, 6, 12, 6, 0])
    for rewind, bits in ((0.0, [0, 0, 1, 0, 0]), (0.5, [0, 0, 1, 1, 1])):
        config = dataclasses.replace(SMALL, rewind=rewind)
        nodes = latents_of(params, demo, active, frames, Hyper(), config)[2]
        assert nodes.active[:, 2].tolist() == [bool(x) for x in bits]
