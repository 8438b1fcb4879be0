"""The gradient of a learned reward as a policy sees it."""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs import Objects

from gril_jax import reward
from gril_jax.config import EnvConfig, PPOConfig, RunConfig, RunSettings, SACConfig
from gril_jax.encoders import encoder
from gril_jax.errors import ConfigError
from gril_jax.rl import rewards
from gril_jax.rl.reward_gradient import directions, observed
from gril_jax.rl.rewards import Reward
from gril_jax.workflows.build import policy_rewards, policy_setup, setup

CONFIG = encoder.EncoderConfig(4, width=8, rounds=1, latent=3)
N = 4  # robot, region and two blocks
NONE = jnp.zeros(N, bool)
OF_RUN = {"learned": 0, "stages": 1, "shaped": 0}  # forms, and what their policies see of a memory


class Moment(NamedTuple):
    """As much of a task's state as a learned reward looks at."""

    objects: Objects


def _moment(center, size=0.2):
    sizes = jnp.broadcast_to(jnp.asarray(size, jnp.float32), (N, 2))
    return Moment(Objects(jnp.asarray(center), sizes, jnp.arange(N), jnp.arange(N) == 0))


@pytest.fixture(scope="module")
def learned():
    params = jax.jit(encoder.init, static_argnums=1)(jax.random.key(0), CONFIG)
    return reward.RewardParams(params, jnp.ones(3), jnp.float32(1.0), jnp.float32(2.0))


@pytest.fixture(scope="module")
def center():
    return np.random.default_rng(0).uniform(-0.8, 0.8, (N, 2)).astype(np.float32)


VALUE = rewards.learned(CONFIG)


def test_directions_are_the_differences_of_the_reward_relative_to_the_largest(learned, center):
    found = np.asarray(directions(VALUE, learned, _moment(center), NONE))
    value = jax.jit(jax.vmap(lambda c: VALUE(learned, _moment(c), NONE)))
    step = 1e-2 * np.eye(2 * N, dtype=np.float32).reshape(-1, N, 2)
    slope = np.asarray(value(center + step) - value(center - step)).reshape(N, 2) / 2e-2
    np.testing.assert_allclose(found, slope / np.linalg.norm(slope, axis=1).max(), atol=0.02)
    assert np.linalg.norm(found, axis=1).max() == pytest.approx(1.0)
    np.testing.assert_array_equal(found[0], 0)  # the encoder does not see the robot


def test_the_reward_grows_along_them(learned, center):
    found = directions(VALUE, learned, _moment(center), NONE)
    before, after = (VALUE(learned, _moment(c), NONE) for c in (center, center + 0.01 * found))
    assert after > before


def test_what_is_not_there_has_none(learned, center):
    size = np.full((N, 2), 0.2, np.float32)
    size[3] = 0.0
    found = directions(VALUE, learned, _moment(center, size), NONE)
    np.testing.assert_array_equal(found[3], 0)
    assert np.abs(found[1:3]).max() > 0


@pytest.mark.parametrize(
    ("value", "wanted"),
    [
        (lambda params, state, active: 0.0 * jnp.sum(state.objects.center), 0.0),
        # Near flat: it stays as small as it is.
        (lambda params, state, active: 1e-5 * jnp.sum(state.objects.center), 1e-5 / 1e-3),
        (lambda params, state, active: jnp.sum(jnp.sqrt(0.0 * state.objects.center)), 0.0),
    ],
    ids=["flat", "next to flat", "not finite"],
)
def test_where_nothing_is_to_be_gained_they_stay_short_and_finite(value, wanted, center):
    found = directions(value, (), _moment(center), NONE)
    np.testing.assert_allclose(found, np.full((N, 2), wanted), rtol=1e-5)


def test_they_are_the_same_under_jit_and_for_many_scenes_at_once(learned, center):
    one = lambda c: directions(VALUE, learned, _moment(c), NONE)  # noqa: E731
    scenes = np.stack([center, center[::-1], 0.5 * center])
    plain = np.stack([one(c) for c in scenes])
    np.testing.assert_allclose(jax.jit(jax.vmap(one))(scenes), plain, atol=1e-5)


def test_the_policy_sees_them_before_the_rewards_own_memory(learned, center):
    """And the reward, its memory and what it pays stay what they are."""
    counting = Reward(
        init=lambda: jnp.zeros(()),
        step=lambda params, memory, state, active: (memory + 1, 7.0 * (memory + 1)),
        observe=lambda memory: memory[None],
    )
    both = observed(counting, VALUE, N)
    np.testing.assert_array_equal(both.observe(both.init()), np.zeros(2 * N + 1))
    memory, value = both.step(learned, both.init(), _moment(center), NONE)
    expected = directions(VALUE, learned, _moment(center), NONE)
    np.testing.assert_allclose(both.observe(memory), [*np.ravel(expected), 1.0], rtol=1e-6)
    memory, value = both.step(learned, memory, _moment(center), NONE)
    assert value == 14.0


def _run(form, algorithm="ppo", **encoder_options):
    return RunConfig(
        env=EnvConfig(varied_starts=0.0),
        encoder=dataclasses.replace(RunConfig().encoder, width=8, latent=4, **encoder_options),
        ppo=PPOConfig(num_envs=4, num_minibatches=2, observe_gradient=True),
        sac=SACConfig(num_envs=4, observe_gradient=True),
        run=RunSettings(reward=form, algorithm=algorithm),
    )


@pytest.mark.parametrize(("form", "algorithm"), [*((f, "ppo") for f in OF_RUN), ("learned", "sac")])
def test_a_policy_of_each_form_of_the_learned_reward_can_see_it(form, algorithm):
    config = _run(form, algorithm)
    env = setup.make_env(config.env, training=True)
    made = policy_setup.make_algorithm(config, env)
    objects = len(jax.eval_shape(env.reset, jax.random.key(0)).objects.center)
    own = env.observation_size + objects  # with the activity bits
    assert made.observation_size == own + 2 * objects + OF_RUN[form]
    begun = jax.eval_shape(made.episodes.begin, jax.random.key(0))
    moved, _ = jax.eval_shape(
        lambda params, begun: made.episodes.advance(
            params, begun, jnp.zeros(env.action_size), tau=0.1
        ),
        policy_rewards.blank(config, env),
        begun,
    )
    assert jax.tree.map(jnp.shape, moved) == jax.tree.map(jnp.shape, begun)


@pytest.mark.parametrize(
    ("config", "why"),
    [
        (_run("environmental"), "run.reward 'environmental', since only a learned reward has a"),
        (_run("learned", kind="pixels"), "encoder.kind 'pixels', whose reward sees pictures"),
    ],
)
def test_a_reward_without_one_is_told_so(config, why):
    env = setup.make_env(config.env, training=True)
    with pytest.raises(ConfigError, match=f"ppo.observe_gradient is true, but .* for {why}"):
        policy_setup.make_algorithm(config, env)
