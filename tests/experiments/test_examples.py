"""The examples run, and the adapters that they call begin each episode's memory anew."""

import copy
import importlib
import importlib.util

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from brax.envs.base import State
from brax.envs.wrappers import training
from gril_jax.experiments.examples import learn_reward, plain_jax, pushing

from gril_jax.errors import ConfigError
from gril_jax.export import brax
from gril_jax.export.reward_file import load_reward


def _needs(*packages):
    for package in packages:
        if importlib.util.find_spec(package) is None:
            pytest.skip(f"{package} is not installed")


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """The file that the first example writes."""
    path = tmp_path_factory.mktemp("rewards") / "reward.npz"
    said = []
    tau = learn_reward.main(str(path), steps=100, echo=said.append)
    assert tau > 0.9
    assert str(path) in said[0]
    return str(path)


DRIVE = jnp.array([[1.0, 0.0]])


def _expected(learned, tables):
    """The rewards of an episode's tables after its first."""
    return np.asarray(
        jax.jit(lambda t: learned.trajectory(*jax.vmap(pushing.boxes)(t)))(tables)[1:]
    )


def _episode(key, num_steps=23):
    """The tables of an episode in which the robot drives to the right."""
    tables, step = [pushing.reset(key)], jax.jit(pushing.step)
    for _ in range(num_steps):
        tables.append(step(tables[-1], DRIVE[0]))
    return np.stack(tables)


# --- the examples


def test_the_example_in_plain_jax_tells_pushing_from_wandering(file):
    found = plain_jax.main(file, episodes=16, echo=lambda _: None)
    assert found["push"] > -0.2 > -0.5 > found["wander"]
    assert np.isfinite(found["uphill"]).all()


def test_the_brax_example_gives_the_same_rewards_in_both_episodes(file):
    from gril_jax.experiments.examples import brax_wrapper

    rewards = brax_wrapper.main(file, episodes=2, echo=lambda _: None)
    np.testing.assert_allclose(rewards[:23], rewards[23:], atol=1e-6)  # reset to the same state
    first = jax.random.split(jax.random.PRNGKey(0), 2)[0]
    expected = _expected(load_reward(file), _episode(first))
    np.testing.assert_allclose(rewards[:23, 0], expected, atol=1e-5)


def test_the_gymnasium_example_gives_the_rewards_of_each_episode(file):
    _needs("gymnasium")
    from gril_jax.experiments.examples import gymnasium_wrapper

    rewards = gymnasium_wrapper.main(file, echo=lambda _: None)
    for episode, found in enumerate((rewards[:23], rewards[23:])):
        seed = int(gymnasium_wrapper.gymnasium.utils.seeding.np_random(episode)[0].integers(2**31))
        expected = _expected(load_reward(file), _episode(jax.random.key(seed)))
        np.testing.assert_allclose(found, expected, atol=1e-5)


def test_the_rejax_example_learns(file):
    _needs("gymnax", "rejax")
    from gril_jax.experiments.examples import rejax_ppo

    before, after = rejax_ppo.main(file, echo=lambda _: None)
    assert before < -20
    assert after > -13.5


# --- brax's resets, which do not reset `info`


class _Drive:
    """A brax environment that any wrapper may surround."""

    observation_size, action_size = 6, 2
    backend = "none"

    @property
    def unwrapped(self):
        return self

    def reset(self, rng):
        table, zero = pushing.reset(rng), jnp.zeros(())
        return State(table, obs=table.ravel(), reward=zero, done=zero)

    def step(self, state, action):
        table = pushing.step(state.pipeline_state, action)
        return state.replace(pipeline_state=table, obs=table.ravel(), reward=jnp.ones(()))


def _wrapped(file, **options):
    return brax.RewardWrapper(
        _Drive(), load_reward(file), lambda s: pushing.boxes(s.pipeline_state), **options
    )


def _drive(env, num_steps):
    step = jax.jit(env.step)
    state = jax.jit(env.reset)(jax.random.split(jax.random.PRNGKey(0), 1))
    states = []
    for _ in range(num_steps):
        state = step(state, DRIVE)
        states.append(state)
    return states


@pytest.mark.parametrize(("length", "repeat"), [(3, 1), (1, 1), (8, 4)])
def test_bits_of_one_episode_do_not_reach_the_next(file, length, repeat):
    """The robot moves at every step, so that without a reset its bit would stay."""
    env = training.wrap(_wrapped(file, action_repeat=repeat), length, action_repeat=repeat)
    per_episode = length // repeat
    states = _drive(env, 3 * per_episode)
    rewards = np.stack([state.reward[0] for state in states]).reshape(3, per_episode)
    np.testing.assert_allclose(rewards, np.tile(rewards[:1], (3, 1)), atol=1e-6)
    counts = [int(state.info["learned_reward"][1][0]) for state in states]
    assert counts == [*range(repeat, length + 1, repeat)] * 3
    ages = [np.ptp(s.info["learned_reward"][0].activity.past[0, :, 1, 0]) for s in states]
    assert max(ages) <= 0.05 * length + 1e-6


def test_the_tasks_own_reward_is_a_metric(file):
    env = training.wrap(_wrapped(file), 5)
    (state,) = _drive(env, 1)
    assert state.metrics["task_reward"][0] == 1
    assert state.reward[0] < 0


def test_done_without_a_count_of_steps_begins_anew(file):
    env = _wrapped(file)
    state = env.reset(jax.random.key(0))
    state = env.step(state, DRIVE[0])
    assert env.step(state, DRIVE[0]).info["learned_reward"][1] == 2
    ended = state.replace(done=jnp.ones(()), pipeline_state=pushing.reset(jax.random.key(1)))
    memory, count = env.step(ended, DRIVE[0]).info["learned_reward"]
    assert count == 1
    np.testing.assert_allclose(memory.activity.past[-1], ended.pipeline_state)


def test_a_reset_that_hides_the_end_is_refused(file):
    env = training.AutoResetWrapper(training.VmapWrapper(_wrapped(file)))
    state = env.reset(jax.random.split(jax.random.PRNGKey(0), 1))
    with pytest.raises(ConfigError, match="no episode wrapper does"):
        env.step(state, DRIVE)


def test_what_is_not_the_rewards_is_the_environments(file):
    env = _wrapped(file)
    assert (env.observation_size, env.unwrapped) == (6, env.env)
    assert copy.copy(env).action_size == 2
    with pytest.raises(AttributeError, match="no_such"):
        _ = env.no_such


# --- gymnax's


def _gymnax(file, **options):
    _needs("gymnax", "rejax")
    from gril_jax.experiments.examples.rejax_ppo import Pushing, RewardWrapper

    return RewardWrapper(Pushing(), load_reward(file), lambda s: pushing.boxes(s.table), **options)


def test_gymnaxs_reset_begins_the_memory_anew(file):
    env = _gymnax(file)
    _, state = jax.jit(env.reset)(jax.random.key(0))
    table, rewards, step = state.env.table, [], jax.jit(env.step)
    for t in range(24):
        _, state, reward, terminated, truncated, info = step(jax.random.key(t), state, DRIVE[0])
        rewards.append(reward)
        assert (bool(terminated), bool(truncated)) == (False, t == 23)
    assert info["task_reward"] == 0
    assert not state.memory.activity.active.any()
    assert state.env.time == 0
    expected = _expected(load_reward(file), _episode(jax.random.key(0), 24))
    np.testing.assert_allclose(table, pushing.reset(jax.random.key(0)), atol=1e-6)
    np.testing.assert_allclose(rewards, expected, atol=1e-5)


def test_gymnaxs_step_has_five_values_if_asked(file):
    env = _gymnax(file, five_values=True)
    _, state = env.reset(jax.random.key(0))
    _, _, _, done, _ = env.step(jax.random.key(1), state, DRIVE[0])
    assert not done
    assert env.name == "Pushing"
