"""The fleet beside single environments stepped by hand, and its pool of starts."""

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.probes import Probe

from gril_jax.rl import blocks, episodes, rewards, rollout

NUM, LENGTH = 4, 5
EPISODES = episodes.Episodes.of(Probe(episode_length=3), rewards.environmental, window=4)


def _plain(tree):
    def plain(leaf):
        key = jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
        return np.asarray(jax.random.key_data(leaf) if key else leaf)

    return jax.tree.map(plain, tree)


def _at(tree, *place):
    return jax.tree.map(lambda x: x[place], tree)


def _act(observation, key):
    """An action that depends on the observation, the environment and the step."""
    action = observation[:, :1] * jnp.linspace(0.1, 0.8, len(observation))[:, None]
    return action + 0.1 * jax.random.uniform(key), {"first": observation[:, 0]}


def _same(observation, key):
    """An action that does not depend on where among the others an environment is."""
    return 0.3 * observation[:, :1] + 0.1 * jax.random.uniform(key), ()


@pytest.fixture(scope="module")
def begun():
    def init(key):
        key, key_time = jax.random.split(key)
        return rollout.scatter(rollout.init(EPISODES, jax.random.split(key, 2 * NUM)), key_time, 3)

    return jax.jit(init)(jax.random.key(0))._replace(drawn=jnp.asarray(3, jnp.int32))


@pytest.fixture(scope="module")
def unrolled(begun):
    def run(begun, key):
        keys = jax.random.split(key, LENGTH)
        return rollout.unroll(EPISODES, None, begun, _act, keys, tau=0.005)

    return jax.jit(run)(begun, jax.random.key(1))


def test_an_unroll_equals_environments_stepped_by_hand(begun, unrolled):
    """The start for lane i is that at i + drawn; `last` is from before the reset."""
    after, steps = unrolled
    advance = jax.jit(lambda lane, action: EPISODES.advance(None, lane, action, tau=0.005))
    lanes, starts = ([_at(tree, i) for i in range(NUM)] for tree in (begun.running, begun.starts))
    for t, key in enumerate(jax.random.split(jax.random.key(1), LENGTH)):
        observation = jnp.stack([EPISODES.observe(lane) for lane in lanes])
        action, extras = _act(observation, key)
        for i in range(NUM):
            lane, moment = advance(lanes[i], action[i])
            over = bool(moment.terminated + moment.truncated > 0)
            mine = rollout.Rollout(
                observation[i], action[i], _at(extras, i), moment, EPISODES.observe(lane),
                jnp.asarray(over),
            )  # fmt: skip
            chex.assert_trees_all_close(_at(steps, t, i), mine, atol=1e-6)
            lanes[i] = starts[(i + 3) % NUM] if over else lane
    assert steps.ended.sum() > NUM
    for i in range(NUM):
        chex.assert_trees_all_close(_plain(_at(after.running, i)), _plain(lanes[i]), atol=1e-6)
    chex.assert_trees_all_equal(_plain(after.starts), _plain(begun.starts))


def test_the_pool_is_renewed_in_turn_and_only_with_resets_of_the_task(begun):
    renew = jax.jit(lambda x, key: rollout.renew(EPISODES, x, jax.random.split(key, 2)))
    now = begun._replace(drawn=jnp.asarray(0, jnp.int32))
    for number in range(3):
        key = jax.random.key(number)
        before, now = now, renew(now, key)
        assert int(now.drawn) == number + 1
        fresh = jax.vmap(EPISODES.begin)(jax.random.split(key, 2))
        new = [(2 * number) % NUM + i for i in range(2)]
        old = [i for i in range(NUM) if i not in new]
        new, old = jnp.array(new), jnp.array(old)
        chex.assert_trees_all_equal(_plain(_at(now.starts, new)), _plain(fresh))
        chex.assert_trees_all_equal(_plain(_at(now.starts, old)), _plain(_at(before.starts, old)))
        chex.assert_trees_all_equal(_plain(now.running), _plain(before.running))


def test_blocks_of_the_pool_are_fleets_of_their_own(begun, monkeypatch):
    """Two blocks of two: renewing and unrolling gives what each half gives by itself."""

    def run(envs, key):
        key, key_unroll = jax.random.split(key)
        renewed = rollout.renew(EPISODES, envs, jax.random.split(key, NUM))
        keys = jax.random.split(key_unroll, LENGTH)
        return renewed, rollout.unroll(EPISODES, None, renewed, _same, keys, tau=0.005)

    def part(tree, i):
        return jax.tree.map(lambda x: x[2 * i : 2 * i + 2] if x.ndim else x, tree)

    monkeypatch.setattr(blocks, "_LEAST", 2)
    renewed, (after, steps) = run(begun, jax.random.key(5))
    monkeypatch.undo()
    assert steps.ended.sum() > NUM
    for i in range(2):
        alone = renewed._replace(running=part(renewed.running, i), starts=part(renewed.starts, i))
        _, key_unroll = jax.random.split(jax.random.key(5))
        keys = jax.random.split(key_unroll, LENGTH)
        half, half_steps = rollout.unroll(EPISODES, None, alone, _same, keys, tau=0.005)
        chex.assert_trees_all_close(_plain(half.running), _plain(part(after.running, i)), atol=1e-6)
        rewards_ = steps.result.reward[:, 2 * i : 2 * i + 2]
        chex.assert_trees_all_close(half_steps.result.reward, rewards_, atol=1e-6)


@pytest.mark.parametrize("size", [2, 4])
def test_each_block_of_the_pool_is_renewed_in_turn(begun, monkeypatch, size):
    monkeypatch.setattr(blocks, "_LEAST", size)
    parts = NUM // size
    now = begun._replace(drawn=jnp.asarray(0, jnp.int32))
    for number in range(3):
        keys = jax.random.split(jax.random.key(number), parts)
        now = rollout.renew(EPISODES, now, keys)
        new = jnp.array([number % size + size * part for part in range(parts)])
        fresh = jax.vmap(EPISODES.begin)(keys)
        chex.assert_trees_all_equal(_plain(_at(now.starts, new)), _plain(fresh))


class _Unplaced(Probe):
    """Half of its resets fail: the policy would see NaN."""

    def reset(self, key):
        state = super().reset(key)
        return state._replace(obs=jnp.where(state.data.sign > 0, jnp.nan, state.obs))


def test_no_episode_begins_where_the_policy_would_see_nan():
    failing = episodes.Episodes.of(_Unplaced(episode_length=3), rewards.environmental, window=4)
    keys = jax.random.split(jax.random.key(0), 2 * NUM)
    broken = np.isnan(jax.vmap(failing.begin)(keys).state.obs[:, 0])
    assert 0 < broken.sum() < 2 * NUM
    begun = rollout.init(failing, keys)
    own = np.concatenate([begun.running.state.data.sign, begun.starts.state.data.sign])
    np.testing.assert_array_equal(own, -1)
    first, *_ = _plain(begun.running.state.data.key)  # of the others each keeps its own start
    stands_in = (_plain(begun.starts.state.data.key) == first).all(axis=1)
    np.testing.assert_array_equal(stands_in, broken[NUM:])
    for number in range(4):
        keys, place = jax.random.split(jax.random.key(number), 2), 2 * (number % 2) + np.arange(2)
        fresh = jax.vmap(failing.begin)(keys).state
        before, begun = begun, rollout.renew(failing, begun, keys)
        old, new, now = (
            _plain(x.data.key) for x in (before.starts.state, fresh, begun.starts.state)
        )
        wanted = np.where(np.isnan(fresh.obs[:, :1]), old[place], new)
        np.testing.assert_array_equal(now[place], wanted)


@pytest.mark.parametrize("num_envs", [1, 4, 6, 64, 1024, 3000])
@pytest.mark.parametrize("unroll_length", [1, 5, 20, 300])
def test_renewals_divide_the_environments_and_cover_what_time_limits_use_up(
    num_envs, unroll_length
):
    count = rollout.renewals(num_envs, unroll_length, 120)
    assert num_envs % count == 0
    assert count % blocks.count(num_envs) == 0
    assert count >= min(num_envs, num_envs * unroll_length / 120)


def test_a_fleet_has_different_starts_and_no_time_beyond_an_episode(begun):
    keys = jax.random.key_data(
        jnp.concatenate([begun.running.state.data.key, begun.starts.state.data.key])
    )
    assert len(np.unique(keys, axis=0)) == 2 * NUM
    assert set(np.asarray(begun.running.time)) <= {0, 1, 2}
    assert not np.asarray(begun.starts.time).any()


def test_a_summary_counts_only_episodes_that_ended_from_the_tasks_own_start():
    ended = jnp.array([[True, True, False], [False, True, False]])
    number = jnp.zeros((2, 3))
    moment = episodes.StepResult(
        reward=jnp.arange(6.0).reshape(2, 3), terminated=number, truncated=number,
        nonfinite=number.at[0, 0].set(1.0),
        metrics={
            "score": jnp.array([[1.0, 5.0, 9.0], [9.0, 3.0, 9.0]]),
            "varied": number.at[0, 1].set(1.0),
        },
    )  # fmt: skip
    steps = rollout.Rollout(
        number[..., None], number[..., None], (), moment, number[..., None], ended
    )
    found = rollout.summary(steps)
    expected = {"score": (1 + 3) / 2, "episodes": 2.0, "reward": 2.5, "nonfinite": 1.0}
    assert {name: float(value) for name, value in found.items()} == expected


def test_a_summary_without_an_ended_episode_is_zero_not_nan():
    number = jnp.zeros((1, 2))
    moment = episodes.StepResult(number, number, number, number, {"score": number + 7})
    steps = rollout.Rollout(
        number[..., None], number[..., None], (), moment, number[..., None], number > 0
    )
    assert float(rollout.summary(steps)["score"]) == 0
