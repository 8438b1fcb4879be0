"""PPO's loss against brax's, which it rewrites, and its advantages against their definition."""

import functools

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.training.agents.ppo import losses, networks
from brax.training.types import Transition

from gril_jax.rl import ppo_loss
from gril_jax.rl.policy import fresh_normalizer, normalize, observed

LANES, STEPS, INPUTS, ACTIONS = 6, 5, 3, 2
WEIGHTS = ppo_loss.Weights(
    discounting=0.9, gae_lambda=0.7, reward_scaling=0.3, clipping_epsilon=0.1, entropy_cost=0.02
)


@functools.cache
def _networks():
    return networks.make_ppo_networks(
        INPUTS, ACTIONS, preprocess_observations_fn=normalize,
        policy_hidden_layer_sizes=(8,), value_hidden_layer_sizes=(8,),
    )  # fmt: skip


@functools.cache
def _given(seed=0):
    keys = iter(jax.random.split(jax.random.key(seed), 8))
    of = _networks()
    observation = 2 * jax.random.normal(next(keys), (LANES, STEPS + 1, INPUTS)) + 1
    raw_action = jax.random.normal(next(keys), (LANES, STEPS, ACTIONS))
    normalizer = observed(fresh_normalizer(INPUTS), observation)
    params, other = (
        losses.PPONetworkParams(of.policy_network.init(a), of.value_network.init(b))
        for a, b in (jax.random.split(next(keys)), jax.random.split(next(keys)))
    )
    logits = of.policy_network.apply(normalizer, other.policy, observation[:, :-1])
    ended = jax.random.bernoulli(next(keys), 0.2, (LANES, STEPS)).astype(jnp.float32)
    dropped = jax.random.bernoulli(next(keys), 0.2, (LANES, STEPS)).astype(jnp.float32)
    batch = ppo_loss.Batch(
        observation=observation,
        raw_action=raw_action,
        log_prob=of.parametric_action_distribution.log_prob(logits, raw_action),
        reward=jax.random.normal(next(keys), (LANES, STEPS)),
        ended=ended * (1 - dropped),
        dropped=dropped,
    )
    return params, normalizer, batch, logits


def _brax(params, batch, key, weights):
    _, normalizer, _, logits = _given()
    data = Transition(
        observation=batch.observation[:, :-1],
        action=jnp.tanh(batch.raw_action),
        reward=batch.reward,
        discount=1 - batch.ended,
        next_observation=batch.observation[:, 1:],
        extras={
            "policy_extras": {
                "raw_action": batch.raw_action,
                "log_prob": batch.log_prob,
                "distribution_params": logits,
            },
            "state_extras": {"truncation": batch.dropped},
        },
    )
    return losses.compute_ppo_loss(
        params, normalizer, data, key, ppo_network=_networks(), **weights._asdict()
    )


def test_value_parts_and_gradient_are_those_of_brax():
    params, normalizer, batch, _ = _given()
    batch = batch._replace(dropped=jnp.zeros_like(batch.dropped))  # brax learns from these, too
    key, weights = jax.random.key(9), WEIGHTS._replace(entropy_cost=0.0)

    @jax.jit
    def both(params):
        def ours(params):
            return ppo_loss.loss(params, normalizer, batch, key, _networks(), weights)

        def theirs(params):
            return _brax(params, batch, key, weights)

        return [jax.value_and_grad(f, has_aux=True)(params) for f in (ours, theirs)]

    ((value, parts), gradient), ((expected, parts_expected), expected_gradient) = both(params)
    np.testing.assert_allclose(value, expected, rtol=1e-5)
    np.testing.assert_allclose(parts["loss/policy"], parts_expected["policy_loss"], rtol=1e-5)
    np.testing.assert_allclose(parts["loss/value"], parts_expected["v_loss"], rtol=1e-5)
    chex.assert_trees_all_close(gradient, expected_gradient, atol=1e-6, rtol=1e-5)


def test_a_dropped_step_does_not_move_the_policy():
    """An advantage of 0 is the highest where values are low: its action would be sought."""
    params, normalizer, batch, _ = _given()
    dropped, key = batch.dropped[..., None] > 0, jax.random.key(9)
    other = batch._replace(raw_action=jnp.where(dropped, 5.0, batch.raw_action))

    @jax.jit
    def gradient(batch):
        def of_policy(params):
            return ppo_loss.loss(params, normalizer, batch, key, _networks(), WEIGHTS)[1][
                "loss/policy"
            ]

        return jax.grad(of_policy)(params)

    assert 0 < dropped.mean() < 1
    chex.assert_trees_all_close(gradient(batch), gradient(other), atol=1e-7)


def test_entropy_weighs_as_much_as_asked():
    params, normalizer, batch, _ = _given()
    key = jax.random.key(9)
    (none, _), (value, parts) = (
        ppo_loss.loss(params, normalizer, batch, key, _networks(), weights)
        for weights in (WEIGHTS._replace(entropy_cost=0.0), WEIGHTS)
    )
    logits = _networks().policy_network.apply(normalizer, params.policy, batch.observation)
    entropy = _networks().parametric_action_distribution.entropy(logits[:, :-1], key).mean()
    # brax draws the same noise in another order: these agree on average only.
    np.testing.assert_allclose(value - none, -WEIGHTS.entropy_cost * entropy, rtol=1e-4)
    np.testing.assert_allclose(parts["loss/entropy"], value - none, rtol=1e-4)


@pytest.mark.parametrize("gae_lambda", [0.0, 0.7, 1.0])
def test_advantages_are_those_of_brax(gae_lambda):
    _, _, batch, _ = _given()
    value = jax.random.normal(jax.random.key(3), (LANES, STEPS + 1))
    given = {"discounting": 0.9, "gae_lambda": gae_lambda}
    found = jax.jit(functools.partial(ppo_loss.advantages, **given))(
        batch.reward, value, batch.ended, batch.dropped
    )
    expected = losses.compute_gae(
        batch.dropped.T, batch.ended.T, batch.reward.T, value[:, :-1].T, value[:, -1],
        lambda_=gae_lambda, discount=0.9,
    )  # fmt: skip
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other.T, atol=1e-5)


def test_with_lambda_one_the_target_is_the_discounted_sum_of_rewards():
    reward = jnp.array([1.0, 2.0, 4.0, 8.0])
    value = jnp.array([5.0, -3.0, 7.0, 1.0, 16.0])
    ended = jnp.array([0.0, 1.0, 0.0, 0.0])
    target, advantage = ppo_loss.advantages(
        reward, value, ended, jnp.zeros(4), discounting=0.5, gae_lambda=1.0
    )
    expected = np.array([1 + 0.5 * 2, 2, 4 + 0.5 * 8 + 0.25 * 16, 8 + 0.5 * 16])
    np.testing.assert_allclose(target, expected)
    np.testing.assert_allclose(advantage, expected - value[:-1])


def test_an_input_that_never_varied_is_not_divided_by_next_to_nothing():
    seen = jnp.stack([jnp.full(64, 0.4), jnp.arange(64) / 8], axis=1)
    normalizer = observed(fresh_normalizer(2), seen)
    changed = normalize(jnp.array([0.45, 4.0]), normalizer)
    assert 0 < changed[0] < 1  # and 10, the limit, if divided by a deviation of 1e-6
    np.testing.assert_allclose(normalizer.std[1], seen[:, 1].std(), rtol=1e-4)
