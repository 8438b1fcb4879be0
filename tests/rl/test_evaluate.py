"""Evaluation counts what the probe's metrics say, from the task's own starts."""

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.probes import Probe

from gril_jax.rl import evaluate as evaluation
from gril_jax.rl import rewards
from gril_jax.rl.policy import Policy
from gril_jax.rl.ppo import PPO, Hyper, Static

EPISODES, LENGTH = 6, 8
STATIC = Static(num_envs=4, num_minibatches=2, hidden=(8,), window=4)


def _make(**options):
    ppo = PPO(Probe(episode_length=LENGTH, **options), rewards.environmental, STATIC)
    state = jax.jit(ppo.init)(jax.random.key(0), Hyper())
    return ppo, Policy(state.normalizer, state.params.policy)


def _evaluate(ppo, policy, seed=1, **options):
    key_begin, key_act = jax.random.split(jax.random.key(seed))
    begun = evaluation.begin(ppo.episodes, key_begin, episodes=EPISODES)
    return evaluation.evaluate(ppo, policy, None, begun, key_act, tau=0.005, **options)


@pytest.fixture(scope="module")
def made():
    return _make()


@pytest.fixture(scope="module")
def result(made):
    return _evaluate(*made)


def test_shapes_are_episodes_by_steps_and_states_begin_with_the_reset(result):
    assert result.reward.shape == (EPISODES, LENGTH)
    assert result.success.shape == result.success_ever.shape == result.score.shape == (EPISODES,)
    assert result.states.obs.shape == (EPISODES, LENGTH + 1, 2)
    np.testing.assert_array_equal(
        result.states.data.time, np.tile(np.arange(LENGTH + 1), (EPISODES, 1))
    )


def test_success_and_score_are_those_of_the_last_step(result):
    """Success is an action of the sign seen before it: recounted from the states."""
    where = np.asarray(result.states.data.where)[..., 0]
    sign = np.asarray(result.states.data.sign)[:, :-1]
    fits = np.sign(np.diff(where, axis=1)) == sign
    np.testing.assert_array_equal(result.success, fits[:, -1])
    np.testing.assert_array_equal(result.success_ever, fits.any(axis=1))
    np.testing.assert_allclose(result.score, LENGTH / 10)
    assert 0 < np.mean(fits) < 1


def test_reward_is_what_the_policy_is_trained_on(result):
    where = np.asarray(result.states.data.where)[..., 0]
    sign = np.asarray(result.states.data.sign)[:, :-1]
    np.testing.assert_allclose(result.reward, sign * np.diff(where, axis=1) / 0.1, atol=1e-5)


def test_mean_actions_are_the_same_for_every_key_but_samples_are_not(made):
    """All episodes start with a block at the origin; only what is seen differs."""
    ppo, policy = made
    for deterministic, kinds in ((True, 2), (False, EPISODES * LENGTH)):
        played = _evaluate(ppo, policy, deterministic=deterministic)
        action = np.diff(np.asarray(played.states.data.where)[..., 0], axis=1) / 0.1
        bits = np.abs(action) > 0  # activity is seen too, so look at the first step only
        assert bits.any()
        first = action[:, 0].round(5)
        assert len(np.unique(first)) <= kinds if deterministic else len(np.unique(first)) > 2


def test_same_key_same_evaluation(made, result):
    again = _evaluate(*made)
    chex.assert_trees_all_equal(again.reward, result.reward)
    assert not np.array_equal(_evaluate(*made, seed=2).reward, result.reward)


def test_a_broken_episode_stays_where_it_was_and_is_no_success():
    ppo, policy = _make(breaks=3, fragile=0.5)
    result = _evaluate(ppo, policy)
    fragile = np.asarray(result.states.data.heat)[:, 0] > 0
    assert 0 < fragile.sum() < EPISODES
    chex.assert_tree_all_finite((result.reward, result.states.obs))
    time = np.asarray(result.states.data.time)
    assert (time[fragile, -1] == 2).all()
    assert (time[~fragile, -1] == LENGTH).all()
    np.testing.assert_array_equal(np.asarray(result.reward)[fragile, 3:], 0.0)
    np.testing.assert_allclose(result.score[fragile], 0.2)


def test_an_episode_that_the_task_ends_stays_there_and_what_follows_does_not_count():
    result = _evaluate(*_make(ends=3))
    np.testing.assert_array_equal(result.states.data.time[:, 3:], 3)
    np.testing.assert_array_equal(result.reward[:, 3:], 0.0)
    assert (np.asarray(result.reward)[:, :3] != 0).all()
    np.testing.assert_allclose(result.score, 0.3)
    where, sign = (
        np.asarray(x)[:, 2:4] for x in (result.states.data.where, result.states.data.sign)
    )
    fits = np.sign(where[:, 1, 0] - where[:, 0, 0]) == sign[:, 0]  # the third action and its sign
    np.testing.assert_array_equal(result.success, fits)
    assert 0 < fits.sum() < EPISODES


def test_a_second_call_compiles_nothing(made, result):
    ppo, policy = made
    before = evaluation.evaluate._cache_size()
    _evaluate(ppo, jax.tree.map(jnp.copy, policy), seed=9)
    assert evaluation.evaluate._cache_size() == before
