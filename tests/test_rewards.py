"""Rewards for policies: plain, with a memory, weighted, and a chain of subtasks."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs import Objects

from gril_jax import encoder, graphs, reward, subtask_chain
from gril_jax.rl import rewards
from gril_jax.rl.rewards import Reward

CONFIG = encoder.EncoderConfig(3, width=4, rounds=1, latent=3)
FRAMES = 6
ALPHA = 3.0


class Moment(NamedTuple):
    """As much of a task's state as a reward looks at."""

    objects: Objects
    reward: jax.Array


def _moments():
    """A block that moves along a line, and the activity bits of each frame."""
    x = jnp.linspace(-0.5, 0.5, FRAMES)
    center = jnp.tile(jnp.array([[0.5, 0.5], [-0.5, 0.0], [0.0, 0.0]]), (FRAMES, 1, 1))
    objects = Objects(
        center=center.at[:, 2, 0].set(x),
        size=jnp.full((FRAMES, 3, 2), 0.2),
        label=jnp.tile(jnp.arange(3), (FRAMES, 1)),
        is_robot=jnp.tile(jnp.arange(3) == 1, (FRAMES, 1)),
    )
    active = jnp.zeros((FRAMES, 3), bool).at[2:, 2].set(True)
    return Moment(objects, 2.0 * x), active


def _run(rule, params):
    """Rewards of an episode, and what the policy sees after each of its frames."""

    def move(memory, now):
        memory, value = rule.step(params, memory, *now)
        return memory, (value, rule.observe(memory))

    return jax.lax.scan(move, rule.init(), _moments())[1]


def _counting():
    """Remembers how many frames it has seen, and pays so many times its parameter."""
    return Reward(
        init=lambda: jnp.zeros(()),
        step=lambda params, memory, state, active: (memory + 1, params * (memory + 1)),
        observe=lambda memory: memory[None],
    )


@pytest.fixture(scope="module")
def encoded():
    """The encoder's weights, and the latents of all frames."""
    params = jax.jit(encoder.init, static_argnums=1)(jax.random.key(0), CONFIG)
    moments, active = _moments()

    def latent(objects, active):
        seen = objects.center, objects.size, objects.label, objects.is_robot
        return encoder.apply(params, graphs.scene_graph(*seen, active), CONFIG, alpha=ALPHA)

    return params, jax.jit(jax.vmap(latent))(moments.objects, active)


def test_a_plain_reward_as_one_with_a_memory_remembers_and_shows_nothing():
    rule = rewards.as_reward(rewards.environmental)
    assert jax.tree.leaves(rule.init()) == []
    values, seen = _run(rule, None)
    np.testing.assert_allclose(values, _moments()[0].reward)
    assert seen.shape == (FRAMES, 0)


def test_a_reward_with_a_memory_stays_what_it_is():
    rule = _counting()
    assert rewards.as_reward(rule) is rule
    np.testing.assert_allclose(_run(rule, 0.5)[0], 0.5 * np.arange(1, FRAMES + 1))


def test_the_learned_reward_is_that_of_the_scene_with_its_activity_bits(encoded):
    params, latents = encoded
    learned = reward.RewardParams(params, latents[-1], jnp.float32(2.0), jnp.float32(ALPHA))
    values, _ = _run(rewards.as_reward(rewards.learned(CONFIG)), learned)
    expected = -2.0 * np.linalg.norm(latents - latents[-1], axis=1)
    np.testing.assert_allclose(values, expected, atol=1e-5)


@pytest.mark.parametrize("mode", ["continuous", "stepped"])
def test_subtasks_pay_what_the_chain_pays_for_the_same_frames(encoded, mode):
    params, latents = encoded
    goals = latents[jnp.array([2, 5])]
    near = jnp.linalg.norm(latents[0] - goals[0])
    chain = subtask_chain.ChainParams(
        goals, jnp.full(2, 1 / near), jnp.full(2, 0.05), jnp.array(2, jnp.int32)
    )
    rule = rewards.subtasks(CONFIG, mode=mode, alpha=ALPHA)
    values, seen = _run(rule, (params, chain))
    expected, progress = subtask_chain.trajectory(chain, latents, mode=mode)
    np.testing.assert_allclose(values, expected, atol=1e-5)
    np.testing.assert_allclose(seen[:, 0], np.asarray(progress) / 2, atol=1e-6)
    assert 0 < float(seen[-1, 0])  # a goal was reached


def test_a_weighted_sum_pays_the_sum_and_shows_every_memory():
    rule = rewards.weighted_sum([rewards.environmental, _counting(), _counting()])
    params = (jnp.array([1.0, 10.0, -1.0]), (None, 0.5, 2.0))
    values, seen = _run(rule, params)
    count = np.arange(1, FRAMES + 1)
    expected = np.asarray(_moments()[0].reward) + 10 * 0.5 * count - 2 * count
    np.testing.assert_allclose(values, expected, rtol=1e-6)
    np.testing.assert_array_equal(seen, np.stack([count, count], axis=1))


def test_weights_can_be_swept_by_a_vmap():
    rule = rewards.weighted_sum([rewards.environmental, _counting()])
    weights = jnp.array([[1.0, 0.0], [0.0, 1.0]])
    swept = jax.vmap(lambda w: _run(rule, (w, (None, 1.0)))[0])(weights)
    for i in range(2):
        np.testing.assert_allclose(swept[i], _run(rule, (weights[i], (None, 1.0)))[0], rtol=1e-6)
