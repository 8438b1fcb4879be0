"""PPO: what its step must not depend on, lanes and metrics, and noise that is held."""

import dataclasses
import functools

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.probes import Probe

from gril_jax.rl.ppo import PPO, Hyper, Static

STATIC = Static(
    num_envs=16, unroll_length=8, num_minibatches=2, num_epochs=4, hidden=(16,), window=4
)
GAMMA = 0.8
HYPER = Hyper(*map(jnp.float32, Hyper(learning_rate=5e-3, discounting=GAMMA)))
CONSTANT, _, DONE, _ = np.eye(4, dtype=np.float32)  # what is rewarded


def weighted(weights, state, active):
    """A constant, the sign that was seen, action times sign, and the task's end."""
    del active
    return weights @ jnp.stack([jnp.ones(()), state.data.before, state.reward, state.done])


def _ppo(static=STATIC, **options):
    return PPO(Probe(**options), weighted, static)


def _mean_action(ppo, state, sign):
    seen = jnp.array([sign, 0], jnp.float32)
    logits = ppo.networks.policy_network.apply(state.normalizer, state.params.policy, seen)
    return float(ppo.networks.parametric_action_distribution.mode(logits)[0])


UNSEEING = Static(**{**STATIC.__dict__, "observe_activity": False})


# ---------------------------------------------------------------- what step must not depend on


@pytest.fixture(scope="module")
def seeing():
    """With activity bits: the default."""
    return _ppo()


@pytest.fixture(scope="module")
def step(seeing):
    def once(state, hyper, weights):
        return seeing.step(state, hyper, weights)

    return jax.jit(chex.assert_max_traces(once, n=1))


@pytest.fixture(scope="module")
def init(seeing):
    return jax.jit(seeing.init)


def _numbers(tree):
    def plain(leaf):
        key = jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
        return np.asarray(jax.random.key_data(leaf) if key else leaf)

    return jax.tree.map(plain, tree)


def test_step_compiles_once_and_counts_its_updates(init, step):
    state = init(jax.random.key(0), HYPER)
    for _ in range(3):
        state, _ = step(state, HYPER, jnp.asarray(DONE))
    assert int(state.updates) == 3


def test_same_key_same_training_and_another_key_another(init, step):
    def run(seed):
        state = init(jax.random.key(seed), HYPER)
        for _ in range(2):
            state, metrics = step(state, HYPER, jnp.asarray(DONE))
        return _numbers((state, metrics))

    chex.assert_trees_all_equal(run(0), run(0))
    a, b = jax.tree.leaves(run(0)[0].params)[0], jax.tree.leaves(run(1)[0].params)[0]
    assert not np.allclose(a, b)


def test_where_a_run_is_cut_into_chunks_changes_no_bit(seeing, init):
    @functools.partial(jax.jit, static_argnames="updates")
    def chunk(state, updates):
        def update(state, _):
            return seeing.step(state, HYPER, jnp.asarray(DONE))

        return jax.lax.scan(update, state, length=updates)[0]

    start = init(jax.random.key(0), HYPER)
    whole, parts = chunk(start, 2), chunk(chunk(start, 1), 1)
    chex.assert_trees_all_equal(_numbers(whole), _numbers(parts))


def test_seeds_side_by_side_equal_seeds_one_by_one(seeing, init, step):
    keys = jax.random.split(jax.random.key(3), 2)
    both = jax.vmap(seeing.init, in_axes=(0, None))(keys, HYPER)
    both, _ = jax.jit(jax.vmap(seeing.step, in_axes=(0, None, None)))(both, HYPER, DONE)
    for i, key in enumerate(keys):
        alone, _ = step(init(key, HYPER), HYPER, jnp.asarray(DONE))
        beside = jax.tree.map(lambda x, i=i: x[i], both)
        chex.assert_trees_all_close(_numbers(beside), _numbers(alone), atol=1e-4, rtol=1e-4)


def test_parameters_of_the_reward_are_an_argument(init, step):
    """No second trace, other rewards: `step` fails when it is traced twice."""
    state = init(jax.random.key(0), HYPER)
    for weights, expected in ((CONSTANT, 1.0), (-3 * CONSTANT, -3.0)):
        _, metrics = step(state, HYPER, jnp.asarray(weights))
        assert float(metrics["reward"]) == pytest.approx(expected)


def test_hyper_parameters_are_an_argument(init, step):
    state = init(jax.random.key(0), HYPER)
    frozen, _ = step(state, HYPER._replace(learning_rate=jnp.float32(0)), jnp.asarray(DONE))
    chex.assert_trees_all_equal(_numbers(frozen.params), _numbers(state.params))
    moved, _ = step(state, HYPER, jnp.asarray(DONE))
    assert not np.allclose(*(jax.tree.leaves(s.params)[-1] for s in (moved, state)))


# ---------------------------------------------------------------- lanes, metrics, acting


def test_lanes_begin_at_scattered_times(init):
    time = np.asarray(init(jax.random.key(0), HYPER).envs.running.time)
    assert time.min() >= 0
    assert time.max() < 8
    assert len(set(time)) > 4


def test_every_lane_ends_once_in_an_unroll_as_long_as_an_episode(init, step):
    """And begins anew: bits and time of an old episode would show."""
    before = init(jax.random.key(0), HYPER)
    after, metrics = step(before, HYPER, jnp.asarray(DONE))
    assert float(metrics["episodes"]) == STATIC.num_envs
    np.testing.assert_array_equal(
        after.envs.running.time, before.envs.running.time
    )  # 8 more, modulo 8
    begun = np.asarray(after.envs.running.time) == 0
    assert begun.any()
    assert not np.asarray(after.envs.running.memory.active)[begun].any()
    assert np.asarray(after.envs.running.memory.active)[~begun, 2].any()
    assert not np.asarray(after.envs.running.state.data.where)[begun].any()


def test_metrics_hold_losses_episodes_and_the_tasks_own(init, step):
    _, metrics = step(init(jax.random.key(0), HYPER), HYPER, jnp.asarray(DONE))
    assert {"reward", "episodes", "nonfinite", "score", "success"} <= set(metrics)
    assert any(name.startswith("loss/") for name in metrics)
    assert float(metrics["score"]) == pytest.approx(0.1 * _mean_length(init), abs=1e-5)
    chex.assert_tree_all_finite(metrics)


def _mean_length(init):
    """First episodes begin at scattered times, so they are 8 minus that long."""
    return float(np.mean(8 - np.asarray(init(jax.random.key(0), HYPER).envs.running.time)))


def test_policy_sees_activity_bits_unless_told_not_to(seeing):
    assert _ppo(UNSEEING).observation_size == 2
    assert seeing.observation_size == 2 + 3


def test_actions_are_in_the_box_and_random_only_if_asked(seeing, init):
    state = init(jax.random.key(0), HYPER)
    policy = seeing.policy(state)
    lane = jax.tree.map(lambda x: x[0], state.envs.running)

    def act(key, deterministic):
        return seeing.act(policy, lane, key, deterministic=deterministic)

    keys = jax.random.split(jax.random.key(1), 50)
    drawn = jax.vmap(lambda key: act(key, False))(keys)
    assert drawn.shape == (50, 1)
    assert np.abs(drawn).max() <= 1
    assert len(np.unique(drawn)) == 50
    mean = jax.vmap(lambda key: act(key, True))(keys)
    assert len(np.unique(mean)) == 1


# ---------------------------------------------------------------- held noise


def _noise(share):
    """The noise of the actions of an unroll (T, B, A), in standard deviations."""
    ppo = _ppo(dataclasses.replace(UNSEEING, num_envs=4096, noise_correlation=share))
    state = ppo.init(jax.random.key(0), HYPER)
    means = jnp.arange(4096) % 2 == 0
    collect = jax.jit(lambda s, k: ppo.collect(s, k, HYPER, CONSTANT, deterministic=means)[1])
    steps = collect(state, state.key)
    logits = ppo.networks.policy_network.apply(
        state.normalizer, state.params.policy, steps.observation
    )
    dist = ppo.networks.parametric_action_distribution.create_dist(logits)
    played = jnp.where(means[:, None], jnp.tanh(dist.loc), jnp.tanh(steps.extras["raw_action"]))
    np.testing.assert_allclose(steps.action, played, atol=1e-6)
    return np.asarray((steps.extras["raw_action"] - dist.loc) / dist.scale)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_noise_is_held_in_part_for_an_unroll_and_is_as_wide_as_ever(share):
    noise = _noise(share)[..., 0]
    length = len(noise)
    assert noise.std() == pytest.approx(1, abs=0.04)
    assert noise.mean() == pytest.approx(0, abs=0.04)
    between = np.corrcoef(noise)[~np.eye(length, dtype=bool)]  # steps, over environments
    np.testing.assert_allclose(between.mean(), share, atol=0.03)
    assert abs(np.corrcoef(noise[0, :-1], noise[0, 1:])[0, 1]) < 0.05  # environments


def test_a_policy_learns_with_held_noise():
    ppo = _ppo(dataclasses.replace(UNSEEING, noise_correlation=0.5))
    start = ppo.init(jax.random.key(0), HYPER)
    step = jax.jit(lambda s: jax.lax.scan(lambda s, _: ppo.step(s, HYPER, DONE), s, length=120)[0])
    state = step(start)
    assert _mean_action(ppo, state, 1) > 0.5
    assert _mean_action(ppo, state, -1) < -0.5
