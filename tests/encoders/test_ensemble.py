"""Ensembles: the members side by side, and the reward of the most pessimistic of them."""

import dataclasses
import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.graph_frames import random_frame
from support.kinematic_demos import kinematic_demos

from gril_jax import reward
from gril_jax.encoders import encoder, ensemble
from gril_jax.encoders.encoder import EncoderConfig, MLPConfig
from gril_jax.errors import ConfigError, ShapeError
from gril_jax.graphs.scene import safe_norm, scene_graph
from gril_jax.pretraining import pretrain
from gril_jax.pretraining.pretrain import Hyper, Static
from gril_jax.reward.latent_goal import RewardParams

ONE = EncoderConfig(num_classes=4, width=6, rounds=1, latent=3)
ALL = dataclasses.replace(ONE, ensemble_size=3)
KEY = jax.random.key(0)
apply, at = jax.jit(encoder.apply), jax.jit(reward.latent_reward)
make = jax.jit(reward.from_latents, static_argnames=("goals", "ensemble_size"))


@pytest.fixture(scope="module")
def params():
    return jax.jit(encoder.init)(KEY, ALL)


def _member(tree, k):
    return jax.tree.map(lambda x: x[k], tree)


def _points(*shape, seed=0):
    return jnp.asarray(np.random.default_rng(seed).normal(size=shape), jnp.float32)


def _ensemble(goal, scale):
    return RewardParams({}, goal, jnp.asarray(scale, jnp.float32), jnp.ones(()))


# --- the encoder


def test_members_are_networks_of_their_own_and_their_latents_lie_side_by_side(params):
    graph = scene_graph(**random_frame())
    latent = apply(params, graph, ALL)
    assert latent.shape == (ensemble.latent_size(ALL),) == (9,)
    parts = ensemble.split(latent, 3)
    init = jax.jit(encoder.init)
    for k, key in enumerate(jax.random.split(KEY, 3)):
        np.testing.assert_allclose(
            parts[k], apply(_member(params, k), graph, ONE), rtol=1e-4, atol=1e-6
        )
        alone = init(key, ONE)
        np.testing.assert_allclose(parts[k], apply(alone, graph, ONE), rtol=1e-4, atol=1e-6)
    assert len(np.unique(np.asarray(parts), axis=0)) == 3


def test_an_encoder_without_members_is_one_network():
    assert (ensemble.num_members(MLPConfig(4)), ensemble.latent_size(ONE)) == (1, 3)
    assert ensemble.member(ALL) == ONE == ensemble.member(ONE)


# --- the reward


def test_the_reward_is_the_lowest_of_its_members(params):
    demos = jax.tree.map(jnp.asarray, kinematic_demos(0, 3, num_objects=4, max_length=12))
    learned = reward.from_demos(params, demos, ALL)
    alone = [reward.from_demos(_member(params, k), demos, ONE) for k in range(3)]
    np.testing.assert_allclose(learned.scale, [x.scale for x in alone], rtol=1e-4)
    value = jax.jit(reward.latent_goal_reward)
    lowest = set()
    for seed in range(8):
        graph = scene_graph(**random_frame(seed, num_nodes=4, absent=None))
        each = [float(value(one, graph, ONE)) for one in alone]
        lowest.add(int(np.argmin(each)))
        np.testing.assert_allclose(value(learned, graph, ALL), min(each), rtol=1e-4)
    assert len(lowest) > 1


@pytest.mark.parametrize("goals", [1, 5])
def test_each_member_is_scaled_as_if_it_were_alone(goals):
    first, last = _points(5, 6), _points(5, 6, seed=1)
    learned = make({}, first, last, goals=goals, ensemble_size=2)
    for k, part in enumerate((slice(0, 3), slice(3, 6))):
        alone = make({}, first[:, part], last[:, part], goals=goals)
        np.testing.assert_allclose(learned.scale[k], alone.scale, rtol=1e-6)
        np.testing.assert_allclose(learned.goal[..., part], alone.goal, rtol=1e-6)
    np.testing.assert_array_less(at(learned, first).mean(), -1.0)  # the lowest of two of mean -1


def test_of_a_set_the_goal_counts_on_which_all_members_come_nearest():
    goals, latents, scale = _points(4, 6), _points(7, 6, seed=1), np.array([0.7, 1.9])
    apart = np.asarray(latents, np.float64)[:, None] - np.asarray(goals, np.float64)
    each = scale * np.linalg.norm(apart.reshape(7, 4, 2, 3), axis=-1)
    distance = each.max(axis=-1)
    np.testing.assert_allclose(at(_ensemble(goals, scale), latents), -distance.min(1), rtol=1e-5)


@pytest.mark.parametrize("num_goals", [None, 2])
def test_gradients_are_those_of_the_worst_member_and_zero_at_the_goal(num_goals):
    goal = _points(*([num_goals] if num_goals else []), 4)
    learned = _ensemble(goal, [1.0, 2.0])
    slope = jax.jit(jax.value_and_grad(lambda x: at(learned, x)))
    here = goal if num_goals is None else goal[0]
    value, gradient = slope(here)
    assert value == 0
    np.testing.assert_array_equal(gradient, np.zeros(4))
    value, gradient = slope(here.at[2:].add(jnp.array([0.03, 0.04])))  # the first is at its goal
    np.testing.assert_allclose(value, -0.1, rtol=1e-3)
    np.testing.assert_allclose(gradient, [0, 0, -1.2, -1.6], atol=1e-3)


def test_rewards_of_ensembles_can_be_vmapped_over_seeds():
    first, last = _points(2, 5, 6), _points(2, 5, 6, seed=1)
    many = jax.vmap(lambda x, y: make({}, x, y, ensemble_size=3))(first, last)
    assert many.scale.shape == (2, 3)
    latents = _points(4, 6, seed=2)
    values = jax.vmap(at, (0, None))(many, latents)
    for i in range(2):
        np.testing.assert_allclose(values[i], at(_member(many, i), latents), rtol=1e-5)


def test_a_lone_network_has_the_very_bits_of_the_plain_formula():
    first, last = _points(5, 6), _points(5, 6, seed=1)

    @jax.jit
    def plain(first, last):
        goal = jnp.mean(last, axis=0)
        scale = 1.0 / jnp.mean(safe_norm(first - goal))
        return scale, -scale * safe_norm(last - goal)

    scale, values = plain(first, last)
    learned = make({}, first, last)
    assert learned.scale.shape == ()
    np.testing.assert_array_equal(learned.scale, scale)
    np.testing.assert_array_equal(at(learned, last), values)


# --- what training measures


def test_what_training_measures_embeds_all_members(params):
    config = Static(encoder=ALL, num_videos=2)
    one = dataclasses.replace(config, encoder=ONE)
    demos = jax.tree.map(jnp.asarray, kinematic_demos(0, 2, num_objects=4, max_length=6))
    found = pretrain.embed(params, demos, Hyper(alpha=2.0), config)
    expected = pretrain.embed(_member(params, 1), demos, Hyper(alpha=2.0), one)
    np.testing.assert_allclose(found[..., 3:6], expected, rtol=1e-4, atol=1e-5)
    with pytest.raises(ConfigError, match=r"encoder\.ensemble_size is 3, but must be 1 here"):
        inspect.unwrap(pretrain.init)(KEY, demos, config)


# --- errors


def test_what_does_not_belong_to_so_many_members_is_refused(params):
    graph = scene_graph(**random_frame())
    with pytest.raises(ShapeError, match=r"array of shape .*, which is 2"):
        encoder.apply(params, graph, dataclasses.replace(ONE, ensemble_size=2))
    for call in (
        encoder.node_embeddings,
        lambda *x: encoder.readout(x[0], jnp.zeros((5, 6)), *x[1:]),
    ):
        with pytest.raises(
            ConfigError, match=r"encoder\.ensemble_size is 3, but must be 1 to embed"
        ):
            call(params, graph, ALL)
    with pytest.raises(ShapeError, match="latent of size 7 does not belong to 2 members"):
        reward.latent_reward(_ensemble(_points(7), [1.0, 1.0]), _points(7))
    with pytest.raises(ShapeError, match="latent of size 6 does not belong to 4 members"):
        inspect.unwrap(reward.from_latents)({}, _points(2, 6), _points(2, 6), ensemble_size=4)
