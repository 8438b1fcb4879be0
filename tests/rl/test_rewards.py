"""Rewards for policies: plain, with a memory, shaped, and in stages."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs import Objects

from gril_jax import graphs, reward
from gril_jax.encoders import encoder, ensemble
from gril_jax.rl import rewards
from gril_jax.rl.rewards import Reward

CONFIG = encoder.EncoderConfig(3, width=4, rounds=1, latent=3)
FRAMES = 6
ALPHA = 3.0


class Moment(NamedTuple):
    """As much of a task's state as a reward looks at."""

    objects: Objects
    reward: jax.Array
    done: jax.Array


class _Pictured(NamedTuple):
    """As much of a task's state as a reward of pictures looks at."""

    data: jax.Array


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
    return Moment(objects, 2.0 * x, jnp.zeros(FRAMES)), active


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


@pytest.mark.parametrize(
    ("config", "spared"),
    [
        (CONFIG, True),
        (encoder.EncoderConfig(3, width=4, latent=3, relations=True, ensemble_size=2), True),
        (encoder.EncoderConfig(3, width=4, latent=3, pair_statistics=True), True),
        (encoder.EncoderConfig(3, width=4, latent=3, pool_robot=True), False),
        (encoder.EncoderConfig(3, width=4, latent=3, robot_messages=True), False),
        (encoder.InteractionConfig(3, width=3, pool_robot=False, robot_messages=False), True),
        (
            encoder.InteractionConfig(
                3,
                width=3,
                distances=True,
                pool_robot=False,
                robot_messages=False,
            ),
            True,
        ),
        (encoder.InteractionConfig(3, width=3), False),
        (encoder.MLPConfig(3, width=4), False),
    ],
)
def test_a_robot_that_does_not_count_is_spared_and_the_reward_is_the_same(
    monkeypatch, config, spared
):
    """The robot moves along a line of its own, so that one that counts would show."""
    params = jax.jit(encoder.init, static_argnums=1)(jax.random.key(0), config)
    scale = jnp.ones(ensemble.num_members(config)) if ensemble.num_members(config) > 1 else 1.0
    goal = jnp.zeros(ensemble.latent_size(config))
    learned = reward.RewardParams(params, goal, jnp.asarray(scale), jnp.float32(ALPHA))
    nodes = []

    def counted(*boxes):
        nodes.append(len(boxes[0]))
        return graphs.scene_graph(*boxes)

    monkeypatch.setattr(rewards, "scene_graph", counted)
    plain, _ = _run(rewards.as_reward(rewards.learned(config)), learned)
    known, _ = _run(rewards.as_reward(rewards.learned(config, robots=(1,))), learned)
    assert nodes == [3, 2 if spared else 3]
    np.testing.assert_allclose(known, plain, atol=1e-6)
    assert encoder.sees_robot(config) is not spared


def test_an_offset_is_paid_at_each_moment_and_none_leaves_the_reward_itself():
    plain = rewards.environmental
    assert rewards.offset(plain, 0.0) is plain
    values, _ = _run(rewards.as_reward(rewards.offset(plain, 1.0)), None)
    np.testing.assert_allclose(values, _moments()[0].reward + 1.0, rtol=1e-6)


def test_a_shaped_reward_adds_the_potential_s_steps_which_telescope_over_an_episode(encoded):
    params, latents = encoded
    learned = reward.RewardParams(params, latents[2], jnp.float32(2.0), jnp.float32(ALPHA))
    rule, weights = rewards.shaped(rewards.learned(CONFIG)), jnp.array([3.0, 0.5])
    moments, active = _moments()

    def run(discount, done):
        def move(memory, now):
            return rule.step((weights, discount, learned), memory, *now)

        return jax.lax.scan(move, rule.init(), (moments._replace(done=done), active))[1]

    discounts = jnp.array([0.9, 1.0, 0.9])
    done = jnp.zeros((3, FRAMES)).at[2, -1].set(1.0)
    found = np.asarray(jax.jit(jax.vmap(run))(discounts, done))
    own = 0.5 * np.asarray(moments.reward)
    potential = -2.0 * np.linalg.norm(latents - latents[2], axis=1)
    for discount, values in zip((0.9, 1.0), found, strict=False):
        before = np.concatenate([[-1.0], potential[:-1]])
        np.testing.assert_allclose(values, 3.0 * (discount * potential - before) + own, atol=1e-4)
        later = discount * potential[1:] - potential[:-1]
        np.testing.assert_allclose(values[1:], 3.0 * later + own[1:], atol=1e-4)
        total = discount ** np.arange(FRAMES) @ (values - own)
        ends = 3.0 * (discount**FRAMES * potential[-1] + 1.0)  # nothing of what lies between
        np.testing.assert_allclose(total, ends, atol=1e-4)
    # Where the task ends, its last potential counts as nothing.
    np.testing.assert_allclose(found[2, :-1], found[0, :-1], atol=1e-5)
    np.testing.assert_allclose(found[2, -1], -3.0 * potential[-2] + own[-1], atol=1e-4)
    assert rule.observe(rule.init()).shape == (0,)


def _fake_value(params, frames, config):
    """In place of a network, which takes long to compile: the mean of the picture decides."""
    assert frames.shape[-3:] == (config.pixels, config.pixels, 3)
    return -params.scale * jnp.abs(frames.mean((-3, -2, -1)) - params.goal[0])


@pytest.mark.parametrize("side_by_side", [False, True])
def test_pictures_of_many_lanes_and_seeds_are_paid_as_each_by_itself(monkeypatch, side_by_side):
    monkeypatch.setattr(rewards, "latent_goal_reward", _fake_value)
    config = encoder.PixelConfig(1, pixels=4)
    rule = rewards.pixels(config, lambda data: jnp.tile(data, (4, 4, 1)), side_by_side=side_by_side)

    def one(params, data):
        return rule(params, _Pictured(data), jnp.zeros(1, bool))

    data = jax.random.randint(jax.random.key(0), (3, 5, 3), 0, 256).astype(jnp.uint8)
    scale, zero = jnp.array([1.0, 2.0, 3.0]), jnp.zeros(3)
    params = reward.RewardParams({}, jnp.array([[0.1], [0.5], [0.9]]), scale, zero)
    lanes = jax.vmap(one, (None, 0))
    found = jax.jit(jax.vmap(lanes))(params, data)
    shared = jax.jit(jax.vmap(lanes, (0, None)))(params, data[0])  # the same pictures for all
    for s in range(3):
        own = jax.tree.map(lambda x, s=s: x[s], params)
        for lane in range(5):
            mean = np.asarray(data)[s, lane].mean() / 255
            expected = -scale[s] * abs(mean - params.goal[s, 0])
            np.testing.assert_allclose(found[s, lane], expected, rtol=1e-5, atol=1e-6)
            np.testing.assert_allclose(found[s, lane], one(own, data[s, lane]), atol=1e-5)
            np.testing.assert_allclose(shared[s, lane], one(own, data[0, lane]), atol=1e-5)


def test_a_saved_reward_is_its_own_parameters_with_its_own_objects(encoded):
    params, latents = encoded
    own = reward.RewardParams(params, latents[2], jnp.float32(2.0), jnp.float32(ALPHA))
    names = ("goal", "robot", "block")
    wanted, _ = _run(rewards.as_reward(rewards.learned(CONFIG)), own)
    for objects in ((), names):
        saved = reward.LearnedReward(own, CONFIG, names, ("robot",), objects)
        values, _ = _run(rewards.as_reward(rewards.saved), saved)
        np.testing.assert_allclose(values, wanted, rtol=1e-5)
