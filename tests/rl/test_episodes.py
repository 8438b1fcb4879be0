"""Episodes: what is forgotten at a reset, how they end, what a broken simulation may touch."""

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.probes import Probe

from gril_jax import envs
from gril_jax.rl import episodes, rewards

WINDOW = 4
BLOCK = 2  # the probe's objects: goal, robot, block


def _episodes(env, reward=rewards.environmental, **options):
    return episodes.Episodes.of(env, reward, window=WINDOW, **options)


def _begin(env, seed=0):
    return _episodes(env).begin(jax.random.key(seed))


def _advance(env, lane, action, reward_fn=rewards.environmental):
    action = jnp.asarray([action], jnp.float32)
    return _episodes(env, reward_fn).advance(None, lane, action, tau=0.005)


def _play(env, actions, seed=0):
    """Lanes after each action, and moments; no reset."""
    lane, lanes, moments = _begin(env, seed), [], []
    for action in actions:
        lane, moment = _advance(env, lane, action)
        lanes.append(lane)
        moments.append(moment)
    return lanes, moments


def test_the_probe_keeps_the_contract():
    env = Probe()
    assert isinstance(env, envs.Env)
    first = jax.eval_shape(env.reset, jax.random.key(0))
    after = jax.eval_shape(env.step, first, jnp.zeros(1))
    assert jax.tree.leaves(first) == jax.tree.leaves(after)


def test_a_new_lane_has_seen_only_its_first_frame():
    lane = _begin(Probe())
    assert int(lane.time) == 0
    assert not lane.memory.active.any()
    centre = lane.state.objects.center
    np.testing.assert_array_equal(lane.memory.past, np.broadcast_to(centre, (WINDOW, 3, 2)))


def test_what_a_varied_start_has_moved_is_active_from_the_first_frame_on():
    lane = _begin(Probe(moved=True))
    assert lane.memory.active.tolist() == [False, False, True]
    lane, _ = _advance(Probe(moved=True), lane, 0.0)
    assert lane.memory.active.tolist() == [False, False, True]


def test_a_moved_block_becomes_active_and_stays_so():
    lanes, _ = _play(Probe(), [0.0, 1.0, -1.0, 0.0, 0.0, 0.0, 0.0])
    bits = [bool(lane.memory.active[BLOCK]) for lane in lanes]
    assert bits == [False, True, True, True, True, True, True]


def test_the_reward_sees_the_activity_of_its_own_moment():
    def bit(params, state, active):
        return active[BLOCK].astype(jnp.float32)

    lane = _begin(Probe())
    lane, moment = _advance(Probe(), lane, 0.0, bit)
    assert float(moment.reward) == 0.0
    _, moment = _advance(Probe(), lane, 1.0, bit)
    assert float(moment.reward) == 1.0


def test_a_reset_forgets_the_activity_memory_and_the_time():
    """Were one leaf of the old lane kept, the new episode would begin with active blocks."""
    lanes, _ = _play(Probe(), [1.0, 1.0])
    old, fresh = lanes[-1], _begin(Probe(), seed=1)
    assert old.memory.active[BLOCK]
    lane = episodes.reset_where(jnp.array(True), fresh, old)
    chex.assert_trees_all_equal(jax.tree.map(_data, lane), jax.tree.map(_data, fresh))
    _, moment = _advance(Probe(), lane, 0.0, lambda p, s, active: active.sum() * 1.0)
    assert float(moment.reward) == 0.0


def test_without_an_end_nothing_is_reset():
    lanes, _ = _play(Probe(), [1.0, 1.0])
    lane = episodes.reset_where(jnp.array(False), _begin(Probe(), seed=1), lanes[-1])
    chex.assert_trees_all_equal(jax.tree.map(_data, lane), jax.tree.map(_data, lanes[-1]))


def _data(leaf):
    """Typed keys as numbers."""
    return jax.random.key_data(leaf) if jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key) else leaf


@pytest.mark.parametrize("ends", [10**6, 3])
def test_the_time_limit_truncates_but_the_tasks_own_end_terminates(ends):
    lanes, moments = _play(Probe(episode_length=3, ends=ends), [0.0] * 3)
    assert [int(lane.time) for lane in lanes] == [1, 2, 3]
    assert [float(m.truncated) for m in moments] == [0, 0, ends > 3]
    assert [float(m.terminated) for m in moments] == [0, 0, ends == 3]


@pytest.fixture(scope="module")
def broken():
    """Eight lanes, some of which break at their third step: lanes before and after, moments."""
    env = Probe(breaks=3, fragile=0.5, episode_length=10)

    @jax.jit
    def run(keys):
        lanes = jax.vmap(_episodes(env).begin)(keys)
        fragile = lanes.state.data.heat > 0
        history = []
        for _ in range(3):
            before = lanes
            lanes, moment = jax.vmap(lambda lane: _advance(env, lane, 0.7))(lanes)
            history.append(moment)
        return fragile, before, lanes, history

    fragile, *rest = run(jax.random.split(jax.random.key(0), 8))
    fragile = np.asarray(fragile)
    assert 0 < fragile.sum() < 8
    return fragile, *rest


def test_a_step_that_is_not_finite_is_taken_back(broken):
    fragile, before, after, _ = broken
    for old, new in zip(*map(jax.tree.leaves, (before, after)), strict=True):
        np.testing.assert_array_equal(_data(new)[fragile], _data(old)[fragile])
    chex.assert_tree_all_finite(jax.tree.map(_data, after))


def test_it_ends_the_episode_with_no_reward_and_is_counted(broken):
    fragile, *_, (_, second, third) = broken
    ended = np.asarray(third.terminated + third.truncated)
    np.testing.assert_array_equal(ended, fragile)
    # No end of the task: else a policy whose reward is never positive would learn to break it.
    assert not third.terminated.any()
    np.testing.assert_array_equal(third.nonfinite, fragile)
    np.testing.assert_array_equal(third.reward[fragile], 0.0)
    assert not second.nonfinite.any()


def test_a_broken_lane_leaves_its_neighbours_alone(broken):
    fragile, _, after, (*_, third) = broken
    assert (np.asarray(after.time)[~fragile] == 3).all()
    assert (np.asarray(third.reward)[~fragile] != 0).all()
    np.testing.assert_allclose(after.state.data.where[~fragile, 0], 0.21, rtol=1e-5)


def test_a_reward_that_is_not_finite_counts_as_broken():
    for bad in (jnp.nan, jnp.inf, -jnp.inf):
        lane = _begin(Probe())
        after, moment = _advance(Probe(), lane, 1.0, lambda p, s, a, bad=bad: jnp.asarray(bad))
        assert float(moment.nonfinite) == 1.0
        assert float(moment.reward) == 0.0
        np.testing.assert_array_equal(after.state.data.where, 0.0)
        assert int(after.time) == 0


def test_an_action_that_is_not_finite_counts_as_broken():
    after, moment = _advance(Probe(), _begin(Probe()), jnp.nan)
    assert float(moment.nonfinite) == 1.0
    chex.assert_tree_all_finite(after.state.objects)


def test_observation_ends_with_the_activity_bits_if_asked():
    lanes, _ = _play(Probe(), [1.0])
    plain = _episodes(Probe(), observe_activity=False).observe(lanes[0])
    both = _episodes(Probe(), observe_activity=True).observe(lanes[0])
    np.testing.assert_array_equal(plain, lanes[0].state.obs)
    np.testing.assert_array_equal(both, [*plain, 0, 0, 1])
    assert both.dtype == jnp.float32


def test_metrics_are_those_of_the_moment():
    _, moments = _play(Probe(), [0.0] * 3)
    np.testing.assert_allclose([float(m.metrics["score"]) for m in moments], [0.1, 0.2, 0.3])
