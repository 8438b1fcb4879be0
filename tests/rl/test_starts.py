"""Starts at moments of the policy's own episodes, beside choices made by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.probes import Probe

from gril_jax.rl import blocks, episodes, ppo, rewards, rollout, sac, starts


def _place(params, state, active):
    """A reward that is where the block is; none at all at the worst place."""
    del params, active
    return jnp.where(state.data.where[0] < 0, jnp.nan, state.data.where[0])


EPISODES = episodes.Episodes.of(Probe(episode_length=9), _place, window=4, chosen_starts=True)


def _running(count):
    """Episodes under way, each of another age, with its block at another place."""
    begun = jax.vmap(EPISODES.begin)(jax.random.split(jax.random.key(1), count))
    places = jax.random.permutation(jax.random.key(2), jnp.linspace(-0.2, 1.0, count))
    data = begun.state.data
    data = data._replace(where=data.where.at[:, 0].set(places))
    return begun._replace(state=begun.state._replace(data=data), time=jnp.arange(count) % 9)


def _mixed(running, fresh, share):
    return jax.jit(lambda key: starts.of_own(EPISODES, None, running, fresh, key, share=share))(
        jax.random.key(3)
    )


@pytest.fixture(scope="module")
def fresh():
    return jax.vmap(EPISODES.begin)(jax.random.split(jax.random.key(4), 64))


def test_the_share_falls_to_nothing_when_a_tenth_of_training_is_left():
    shares = [float(starts.share_left(0.6, p)) for p in (0.0, 0.45, 0.9, 0.95, 1.0, 2.0)]
    np.testing.assert_allclose(shares, [0.6, 0.3, 0, 0, 0, 0], atol=1e-6)


def test_without_a_share_the_fresh_starts_stay_what_they_are(fresh):
    same = _mixed(_running(512), fresh, 0.0)
    for a, b in zip(jax.tree.leaves(same), jax.tree.leaves(fresh), strict=True):
        assert bool(jnp.array_equal(a, b))


def test_moments_stay_in_their_own_block(fresh):
    """The first half of the starts is the first block's, the second the second's."""
    running = _running(512)
    assert blocks.count(512) == 2
    places = np.asarray(running.state.data.where[:, 0]).tolist()
    found = np.asarray(_mixed(running, fresh, 1.0).state.data.where[:, 0])
    lanes = np.array([places.index(x) for x in found])
    assert (lanes[:32] < 256).all()
    assert (lanes[32:] >= 256).all()


def _taken(worth, center, where, seed=0):
    return np.asarray(starts.taken(jax.random.key(seed), *map(jnp.float32, (worth, center, where))))


def test_a_few_that_have_come_far_are_taken_as_often_as_many_that_have_not():
    worth = np.concatenate([np.linspace(0, 0.1, 240), np.linspace(0.1, 1.0, 16)])
    center = np.random.default_rng(0).normal(size=(256, 3, 2))
    where = np.linspace(0, 1, 200)
    found = worth[_taken(worth, center, where)]
    step = 0.9 / 15  # between those that have come far
    assert np.abs(found - where).max() <= 0.05 + step / 2 + 1e-6


def test_of_moments_alike_those_are_taken_that_lie_apart():
    """Of a crowd and one alone 2 lengths off, all paid alike, that one in 2 of 2 + 7 x 0.1."""
    center = np.zeros((8, 1, 2))
    center[:7, 0, 0] = 0.1 * np.arange(7)
    center[7, 0, 0] = 2.6
    found = _taken(np.ones(8), center, np.full(4000, 0.5))
    np.testing.assert_allclose((found == 7).mean(), 2 / 2.7, atol=0.03)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_moment_without_a_finite_reward_is_not_taken(bad):
    worth = np.array([0.0, bad, 1.0, bad])
    found = _taken(worth, np.random.default_rng(0).normal(size=(4, 2, 2)), np.linspace(0, 1, 50))
    assert set(found.tolist()) == {0, 2}


def test_a_moment_keeps_its_memories_and_begins_a_new_clock(fresh):
    running = _running(512)
    bits = jnp.arange(512)[:, None] % 2 == jnp.zeros((1, running.memory.active.shape[1]))
    running = running._replace(memory=running.memory._replace(active=bits))
    found = _mixed(running, fresh, 1.0)
    places = running.state.data.where[:, 0].tolist()
    lanes = [places.index(x) for x in found.state.data.where[:, 0].tolist()]
    assert bool(jnp.array_equal(found.memory.active, bits[jnp.array(lanes)]))
    assert found.time.tolist() == [0] * 64
    assert found.varied.tolist() == [1.0] * 64


def test_as_many_are_replaced_as_the_share_says(fresh):
    assert 0.3 < float(_mixed(_running(512), fresh, 0.5).varied.mean()) < 0.7


def test_success_in_training_counts_the_tasks_own_starts_alone():
    """Two episodes of three end with a success; the one from the task's own start does not."""
    task = Probe(episode_length=2)
    of = episodes.Episodes.of(task, rewards.environmental, window=4, chosen_starts=True)
    begun = jax.vmap(of.begin)(jax.random.split(jax.random.key(0), 3))
    begun = begun._replace(varied=jnp.array([0.0, 1.0, 1.0]))
    state, result = jax.vmap(lambda e: of.advance(None, e, jnp.zeros(1), tau=0.01))(begun)
    assert result.metrics["varied"].tolist() == [0.0, 1.0, 1.0]
    assert state.varied.tolist() == [0.0, 1.0, 1.0]


class Placing(Probe):
    """The probe, with its block put where the box of the last object lies."""

    def place(self, center, size, key):
        del size
        state = self.reset(key)
        return self._state(state.data._replace(where=center[2]), state.reward, state.reward)


def test_a_frame_gives_its_boxes_and_what_has_moved_up_to_it(fresh):
    of = episodes.Episodes.of(Placing(), rewards.environmental, window=4, chosen_starts=True)
    center = jnp.arange(30.0).reshape(5, 3, 2)
    active = jnp.arange(5)[:, None] > jnp.arange(3)
    frames = starts.Frames(center, jnp.ones((5, 3, 2)), active)
    keys = jax.random.split(jax.random.key(0), 64)

    def mixed(share):
        return jax.jit(lambda keys: starts.of_videos(of, frames, fresh, keys, share=share))(keys)

    found, half = mixed(1.0), mixed(0.5)
    shown = (found.state.data.where[:, 0] - 4) // 6
    assert set(shown.tolist()) == {0, 1, 2, 3, 4}
    assert bool(jnp.array_equal(found.memory.active, active[shown.astype(int)]))
    assert found.varied.tolist() == [1.0] * 64
    assert 0.3 < float(half.varied.mean()) < 0.7
    kept = half.varied == 0
    assert bool(jnp.array_equal(half.state.data.where[kept], fresh.state.data.where[kept]))


@pytest.mark.parametrize("share", [0.0, 0.8])
def test_training_begins_some_episodes_at_own_moments_and_ends_without(share):
    static = ppo.Static(
        num_envs=8,
        unroll_length=4,
        hidden=(8,),
        window=4,
        num_minibatches=1,
        visited_state_resets=share,
    )
    algorithm = ppo.PPO(Probe(episode_length=8), rewards.environmental, static)
    hyper = ppo.Hyper(*map(jnp.float32, ppo.Hyper(decay_updates=20.0)))
    state = jax.jit(algorithm.init)(jax.random.key(0), hyper)
    step = jax.jit(lambda state: algorithm.step(state, hyper, None)[0])
    pools = []
    for _ in range(20):
        state = step(state)
        own = state.envs.starts.varied
        pools.append(float(jnp.sum(own)) if share else own)
    if not share:
        assert pools == [()] * 20  # nothing of it is in the program
    else:
        assert max(pools[:8]) > 0
        assert pools[-1] == 0


@pytest.mark.parametrize("kind", [ppo.Hyper, sac.Hyper])
def test_without_a_horizon_the_share_of_chosen_starts_stays(kind):
    assert float(starts.share_left(0.7, 1e6 / kind().decay_updates)) == pytest.approx(0.7)


def test_renewing_puts_the_mixed_starts_into_the_pool():
    keys = jax.random.split(jax.random.key(0), 16)
    envs = rollout.init(EPISODES, keys)
    marked = lambda fresh: fresh._replace(varied=fresh.varied + 1)  # noqa: E731
    after = rollout.renew(EPISODES, envs, keys[:4], marked)
    assert sorted(after.starts.varied.tolist()) == [0.0] * 4 + [1.0] * 4
