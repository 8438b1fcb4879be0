"""Encoder training on made-up demonstrations: blocks carried to a region, one after another."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.kinematic_demos import kinematic_demos

from gril_jax import reward
from gril_jax.audit.scene_reward import Scene
from gril_jax.encoders import encoder
from gril_jax.encoders.encoder import EncoderConfig
from gril_jax.errors import ConfigError
from gril_jax.graphs import activity
from gril_jax.graphs.scene import scene_graph
from gril_jax.pretraining import pretrain
from gril_jax.pretraining.pretrain import Hyper, Static

SMALL = Static(
    encoder=EncoderConfig(num_classes=7, width=8, rounds=1, latent=4),
    updates=3,
    num_videos=3,
    num_frames=6,
)


@pytest.fixture(scope="module")
def demos():
    return jax.tree.map(jnp.asarray, kinematic_demos(0, 5, num_objects=5))


@pytest.fixture(scope="module")
def state(demos):
    return pretrain.init(jax.random.key(0), demos, SMALL)


@pytest.fixture(scope="module")
def stepped(state, demos):
    return pretrain.step(state, demos, Hyper(), SMALL)


def test_held_out_demonstrations_are_ordered_after_a_short_training():
    train, held_out = (
        jax.tree.map(jnp.asarray, kinematic_demos(seed, n, num_objects=4))
        for seed, n in ((0, 60), (1, 10))
    )
    config = Static(encoder=EncoderConfig(num_classes=4), updates=300, num_frames=24)
    state = pretrain.init(jax.random.key(0), train, config)
    before = pretrain.evaluate(state.params.encoder, held_out, train, Hyper(), config)
    state, metrics = pretrain.step(state, train, Hyper(), config)
    after = pretrain.evaluate(state.params.encoder, held_out, train, Hyper(), config)
    assert after["tau"] > 0.8 > before["tau"]
    assert after["reward_time_tau"] > 0.7
    np.testing.assert_allclose(after["reward_first"], -1.0, atol=0.15)
    assert after["reward_last"] > -0.25
    assert metrics.consistency[-20:].mean() < 0.5 * metrics.consistency[:5].mean()
    assert metrics.reconstruction[-20:].mean() < 0.1 * metrics.reconstruction[:5].mean()


def test_step_returns_one_value_per_update_and_counts_them(state, stepped):
    after, metrics = stepped
    assert {x.shape for x in metrics} == {(3,)}
    assert all(np.isfinite(x).all() for x in metrics)
    assert after.num_updates == 3
    assert (metrics.loss > metrics.consistency + metrics.reconstruction).all()  # time agreement
    changed = jax.tree.map(lambda a, b: bool((a != b).any()), state.params, after.params)
    assert all(jax.tree.leaves(changed))


def test_after_the_warmup_the_loss_is_equation_6_alone(state, demos):
    hyper = Hyper(lambda_=0.5, warmup=2.0)
    _, metrics = pretrain.step(state, demos, hyper, SMALL)
    agreement = metrics.loss - metrics.consistency - 0.5 * metrics.reconstruction
    assert agreement[0] > agreement[1] > 1e-3
    np.testing.assert_allclose(agreement[2], 0.0, atol=1e-6)
    _, metrics = pretrain.step(state, demos, hyper._replace(warmup=0.0), SMALL)
    expected = metrics.consistency + 0.5 * metrics.reconstruction
    np.testing.assert_allclose(metrics.loss, expected, rtol=1e-5)


def test_where_a_run_is_cut_into_chunks_changes_no_bit(state, stepped, demos):
    single = dataclasses.replace(SMALL, updates=1)
    for _ in range(3):
        state, _ = pretrain.step(state, demos, Hyper(), single)
    for a, b in zip(jax.tree.leaves(state.params), jax.tree.leaves(stepped[0].params), strict=True):
        np.testing.assert_array_equal(a, b)


def test_batches_are_varied_as_asked(state, stepped, demos):
    losses = {round(float(stepped[1].loss[0]), 4)}
    for change in ({"turn_scenes": True}, {"random_activity": 0.5}):
        config = dataclasses.replace(SMALL, updates=1, **change)
        losses.add(round(float(pretrain.step(state, demos, Hyper(), config)[1].loss[0]), 4))
    assert len(losses) == 3


def test_vmap_over_seeds_and_learning_rates_equals_single_runs(state, stepped, demos):
    keys = jax.vmap(jax.random.key)(jnp.array([0, 0, 1]))
    states = jax.vmap(pretrain.init, (0, None, None))(keys, demos, SMALL)
    rates = jnp.array([1e-3, 1e-2, 1e-3])
    rate_only = Hyper(*[None] * len(Hyper._fields))._replace(learning_rate=0)
    many, metrics = jax.vmap(pretrain.step, (0, None, rate_only, None))(
        states, demos, Hyper(learning_rate=rates), SMALL
    )
    np.testing.assert_allclose(metrics.loss[0], stepped[1].loss, rtol=1e-3)
    np.testing.assert_allclose(metrics.loss[1, 0], metrics.loss[0, 0], rtol=1e-5)
    assert not np.allclose(metrics.loss[1, 2], metrics.loss[0, 2], rtol=1e-3)
    assert not np.allclose(metrics.loss[2], metrics.loss[0], rtol=1e-3)
    alone = jax.tree.leaves(stepped[0].params)
    for batched, one in zip(jax.tree.leaves(many.params), alone, strict=True):
        np.testing.assert_allclose(batched[0], one, rtol=1e-2, atol=1e-4)


def test_embed_equals_the_encoder_frame_by_frame(state, demos):
    params = state.params.encoder
    latents = np.asarray(pretrain.embed(params, demos, Hyper(alpha=2.0), SMALL))

    @jax.jit
    def one(demos, demo, frame):
        center, size, label, is_robot, present, _ = jax.tree.map(lambda x: x[demo], demos)
        active = activity.trajectory(center, size)[frame]
        graph = scene_graph(center[frame], size[frame], label, is_robot, active, present)
        return encoder.apply(params, graph, SMALL.encoder, alpha=2.0)

    for demo, frame in ((0, 0), (1, 30), (4, 70)):
        alone = one(demos, demo, frame)
        np.testing.assert_allclose(latents[demo, frame], alone, rtol=1e-4, atol=1e-5)


def test_evaluation_agrees_with_the_reward_of_the_training_demonstrations(state, demos):
    params = state.params.encoder
    values = pretrain.evaluate(params, demos, demos, Hyper(), SMALL)
    assert set(values) == {"tau", "reward_time_tau", "reward_first", "reward_last"}
    single = jax.tree.map(lambda x: x[:1], demos)
    assert "tau" not in pretrain.evaluate(params, single, demos, Hyper(), SMALL)
    np.testing.assert_allclose(values["reward_first"], -1.0, rtol=1e-4)
    learned = jax.jit(reward.from_demos)(params, demos, SMALL.encoder)
    latents = pretrain.embed(params, demos, Hyper(), SMALL)
    last = np.asarray(latents)[np.arange(5), np.asarray(demos.length) - 1]
    expected = -learned.scale * np.linalg.norm(last - learned.goal, axis=1).mean()
    np.testing.assert_allclose(values["reward_last"], expected, rtol=1e-3)


def test_frames_after_the_length_do_not_enter_the_loss(state, stepped, demos):
    padding = jnp.arange(demos.center.shape[1]) >= demos.length[:, None]
    moved = jnp.where(padding[:, :, None, None], 50.0, demos.center)
    _, metrics = pretrain.step(state, demos._replace(center=moved), Hyper(), SMALL)
    np.testing.assert_array_equal(metrics.loss, stepped[1].loss)


def test_more_videos_in_a_batch_than_demonstrations_is_refused(demos):
    config = dataclasses.replace(SMALL, num_videos=6)
    with pytest.raises(ConfigError, match="num_videos is 6 but there are 5 demonstrations"):
        pretrain.init(jax.random.key(0), demos, config)


@pytest.mark.parametrize(
    ("field", "value"), [("updates", 0), ("num_videos", 1), ("num_frames", 1), ("window", 0)]
)
def test_config_out_of_range_is_refused_by_name(field, value):
    with pytest.raises(ConfigError, match=rf"pretrain\.{field} is {value}"):
        dataclasses.replace(SMALL, **{field: value})


@pytest.mark.slow
def test_a_pool_of_scenes_is_learned_from_without_copies(state, demos, stepped):
    first = Scene(
        demos.center[:, 0], demos.size[:, 0], demos.label, demos.is_robot,
        jnp.zeros(demos.label.shape, bool),
    )  # fmt: skip
    after, metrics = pretrain.step(state, demos, Hyper(), SMALL, first)
    assert (np.asarray(stepped[1].contrast) == 0).all()
    assert (np.asarray(metrics.contrast) > 0).all()
    assert np.isfinite(np.asarray(metrics.loss)).all()
    assert not np.allclose(*(jax.tree.leaves(s.params.encoder)[0] for s in (after, stepped[0])))
