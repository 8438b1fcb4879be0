"""The trainings behind one interface: an ensemble's members, by themselves and side by side."""

import dataclasses
import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.kinematic_demos import kinematic_demos

from gril_jax import reward
from gril_jax.config import EncoderOptions, LossConfig, PretrainConfig, RunConfig
from gril_jax.config.files import load
from gril_jax.config.tables import ALIGNMENTS
from gril_jax.encoders.ensemble import split
from gril_jax.errors import ConfigError
from gril_jax.losses import heads
from gril_jax.pretraining.pretrain import Part
from gril_jax.workflows.build import demonstrations, learners, setup

SEEDS, MEMBERS = 2, 2
CONFIG = RunConfig(  # of few parts, since it is the compiling that takes time
    encoder=EncoderOptions(width=4, rounds=0, latent=2, ensemble_size=MEMBERS),
    loss=LossConfig(decoder="graph"),
    pretrain=PretrainConfig(steps=1, num_videos=2, turn_scenes=False, random_activity=0.0),
)


class _MadeUp(demonstrations.Demonstrations):
    def batch(self, split):
        demos = kinematic_demos(self.names[split], 3, num_objects=4, max_length=8)
        return jax.tree.map(jnp.asarray, demos)


DEMOS = _MadeUp(
    types.SimpleNamespace(classes=("a", "b", "c", "d")), {"train": 0, "validation": 1}, 0
)


def _whole(one):
    """All updates of a step."""
    return Part(one.metrics, jnp.int32(0), jnp.int32(one.static.updates))


@pytest.fixture(scope="module")
def trained():
    """A step of the ensembles of several seeds, as a sweep makes it."""
    one = learners._of_boxes(CONFIG, DEMOS, None)
    hyper = setup.pretrain_hyper(CONFIG)

    @jax.jit
    @jax.vmap
    def train(key):
        fresh = one.init(key, one.data)
        state, metrics = one.step(fresh, one.data, hyper, _whole(one))
        measured = one.measure(state, one.data, hyper)
        return fresh, state, metrics, one.reward(state, one.data, hyper), measured

    keys = jax.random.split(jax.random.key(0), SEEDS)
    return one, *train(keys)


def test_seeds_and_members_all_differ_and_learn(trained):
    _, fresh, state, metrics, _, measured = trained
    for before, after in zip(*map(jax.tree.leaves, (fresh.params, state.params)), strict=True):
        assert before.shape[:2] == (SEEDS, MEMBERS)
        assert (before != after).any()
    kernel = state.params.encoder["head"]["Dense_0"]["kernel"]
    assert len(np.unique(np.asarray(kernel).reshape(SEEDS * MEMBERS, -1), axis=0)) == 4
    batches = jax.random.key_data(state.key).reshape(SEEDS * MEMBERS, -1)
    assert len(np.unique(batches, axis=0)) == 4
    assert metrics.loss.shape == (SEEDS, 1)
    assert np.isfinite(metrics.loss).all()
    assert np.isfinite(measured["tau"]).all()


def test_a_member_is_trained_as_a_network_by_itself(trained):
    _, fresh, state, metrics, _, _ = trained
    alone = dataclasses.replace(
        CONFIG, encoder=dataclasses.replace(CONFIG.encoder, ensemble_size=1)
    )
    one = learners._of_boxes(alone, DEMOS, None)
    hyper = setup.pretrain_hyper(alone)
    losses = []
    for k in range(MEMBERS):
        before, after = jax.tree.map(lambda x, k=k: x[1, k], (fresh, state.params))
        lone, found = one.step(before, one.data, hyper, _whole(one))
        losses.append(found.loss)
        for a, b in zip(*map(jax.tree.leaves, (lone.params, after)), strict=True):
            np.testing.assert_allclose(a, b, atol=1e-5)
    np.testing.assert_allclose(metrics.loss[1], np.mean(losses, axis=0), rtol=1e-4)


def test_the_reward_has_the_shapes_of_a_blank_one_and_is_zero_at_best(trained):
    _, _, _, _, params, _ = trained
    blank = setup.blank_reward(CONFIG, 4)
    first = jax.tree.map(lambda x: x[0], params)
    assert jax.tree.map(jnp.shape, first) == jax.tree.map(jnp.shape, blank)
    assert split(first.goal, MEMBERS).shape == (MEMBERS, 2)
    assert float(reward.latent_reward(first, first.goal)) == 0


def test_graphirls_network_knows_classes_and_distances():
    config = RunConfig(encoder=EncoderOptions(kind="interaction"))
    found = setup.encoder_config(config, 7)
    assert found.distances
    assert found.num_classes == 7


def test_an_encoder_that_knows_what_classes_share_gets_their_words_from_the_task():
    config = load("magical_suite", ["--env.name", "find_dupe"])
    found = setup.encoder_config(config, 21)
    robot, green_region, blue_region, green_star = (found.words[2 * i :][:2] for i in (0, 1, 2, 5))
    assert green_region[0] == green_star[0] != blue_region[0]  # a colour
    assert green_region[1] == blue_region[1] != green_star[1]  # a kind
    assert not {*robot} & {*green_region, *blue_region, *green_star}
    plain = load(
        "magical_suite", ["--env.name", "find_dupe", "--encoder.share-attributes", "False"]
    )
    assert setup.encoder_config(plain, 21).words == ()
    films = load("own_videos", ["--encoder.share-attributes", "True"])
    with pytest.raises(ConfigError, match=r"encoder\.share_attributes is True, but must be False"):
        setup.encoder_config(films, 4)


@pytest.mark.parametrize("method", [name for name, one in ALIGNMENTS.items() if one.head])
def test_a_blank_reward_has_the_shapes_of_one_that_predicts_progress(method):
    config = RunConfig(
        encoder=EncoderOptions(width=4, rounds=0, latent=3), loss=LossConfig(consistency=method)
    )
    blank = setup.blank_reward(config, 4)
    head = heads.of(method).init(jax.random.key(0), 3)
    made = reward.from_latents(blank.encoder, jnp.zeros((2, 3)), jnp.ones((2, 3)), head=head)
    assert jax.tree.map(jnp.shape, made) == jax.tree.map(jnp.shape, blank)
