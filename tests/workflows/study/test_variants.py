"""Policies of a study in every variant of their task."""

import dataclasses

import jax
import numpy as np
import pytest

from gril_jax.config.files import load
from gril_jax.rl import evaluate
from gril_jax.workflows.build import policy_rewards, policy_setup, setup
from gril_jax.workflows.study import saved, variants
from gril_jax.workflows.study.rewards import TrainedReward, reward_key

SMALL = [
    "--task", "move_to_region", "--encoder.width", "8", "--encoder.latent", "4",
    "--ppo.hidden", "8", "--ppo.by-object", "False", "--ppo.video-state-resets", "0",
]  # fmt: skip


def _rewards(config, env, count):
    """Parameters of so many rewards, which differ."""
    blank = policy_rewards.blank(config, env)
    leaves, tree = jax.tree.flatten(blank)
    keys = jax.random.split(jax.random.key(1), len(leaves))
    drawn = [
        0.3 * jax.random.normal(k, (count, *x.shape)) for k, x in zip(keys, leaves, strict=True)
    ]
    return jax.tree.unflatten(tree, drawn)


@pytest.fixture(scope="module")
def played():
    """Two policies that observe the gradient, each of a reward of its own, in all variants."""
    config = load("magical_suite", [*SMALL, "--ppo.observe-gradient", "True"])
    config = dataclasses.replace(config, env=dataclasses.replace(config.env, episode_length=6))
    env = setup.make_env(config.env, training=False)
    algorithm = policy_setup.make_algorithm(config, env)
    keys = jax.random.split(jax.random.key(0), 2)
    policies = jax.vmap(lambda key: policy_setup.fresh_policy(config, algorithm, key))(keys)
    rewards = _rewards(config, env, 2)
    on = variants.ground(config, 2, 3)
    return config, policies, rewards, variants.figures(on, policies, rewards)


def test_each_policy_is_played_with_the_reward_whose_gradient_it_observes(played):
    """As episode by episode in the task itself."""
    config, policies, rewards, (_, means) = played
    env = setup.make_env(config.env, training=False, variant="all")
    algorithm = policy_setup.make_algorithm(config, env)
    demo = setup.make_env(config.env, training=False, variant="demo")
    episodes = dataclasses.replace(algorithm.episodes, env=demo)
    begun = evaluate.begin(episodes, jax.random.key(0), episodes=3)
    begun = jax.tree.map(lambda x: x[0], begun)

    def episode(policy, reward):
        def move(now, _):
            action = algorithm.act(policy, now, jax.random.key(0), deterministic=True)
            return algorithm.episodes.advance(reward, now, action, tau=config.pool.tau)[0], action

        return jax.lax.scan(move, begun, length=env.episode_length)

    one = jax.jit(episode)
    for k in range(2):
        policy, own, other = (
            jax.tree.map(lambda x, i=i: x[i], tree)
            for tree, i in ((policies, k), (rewards, k), (rewards, 1 - k))
        )
        last, actions = one(policy, own)
        pose = jax.tree.map(lambda x, k=k: x[k, -1], means.data).pose
        np.testing.assert_allclose(pose, last.state.data.pose, atol=1e-4)
        assert np.abs(np.asarray(one(policy, other)[1]) - actions).max() > 1e-3


def test_figures_are_of_every_variant_and_policy(played):
    found, _ = played[-1]
    assert {name.partition("_")[0] for name in found} == {"success", "score", "sampled", "worst"}
    names = variants.known("move_to_region")
    assert {name.partition("_")[2] for name in found} == {*names}
    assert all(
        len(values) == 2 and 0 <= min(values) <= max(values) <= 1 for values in found.values()
    )


def test_a_policy_that_observes_no_gradient_is_played_without_a_reward():
    config = load("magical_suite", SMALL)
    assert variants._played_as(config).run.reward == "environmental"
    seen = load("magical_suite", [*SMALL, "--ppo.observe-gradient", "True"])
    assert variants._played_as(seen).run.reward == "learned"


def test_where_a_reward_was_lost_its_policy_is_played_with_anothers(monkeypatch):
    config = load("magical_suite", [*SMALL, "--ppo.observe-gradient", "True"])
    other = load("magical_suite", [*SMALL, "--ppo.observe-gradient", "True", "--loss.touch", "0"])
    rows = [saved.Row(0, 0, other), saved.Row(1, 0, config)]
    known = TrainedReward(np.ones(2), None, None, 3, None)
    monkeypatch.setattr(variants.policy_rewards, "parameters", lambda config, params, *_: params)
    found = variants._rewards_of(rows, {reward_key(config): known})
    np.testing.assert_array_equal(found, np.ones((2, 2)))
