"""Kendall's tau against scipy, alignment against a plain loop, and the separation ratio."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

from gril_jax import metrics
from gril_jax.errors import ConfigError


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("levels", [3, 1000])
def test_tau_equals_scipys_tau_b_with_and_without_ties(seed, levels):
    x = np.random.default_rng(seed).integers(0, levels, 40)
    expected = scipy.stats.kendalltau(np.arange(40), x).statistic
    np.testing.assert_allclose(metrics.kendall_tau(jnp.asarray(x)), expected, atol=1e-5)


def test_tau_counts_only_the_given_length():
    x = jnp.asarray(np.random.default_rng(0).normal(size=30), jnp.float32)
    expected = metrics.kendall_tau(x[:11])
    np.testing.assert_allclose(jax.jit(metrics.kendall_tau)(x, 11), expected, rtol=1e-6)


def test_tau_is_one_minus_one_or_zero_at_its_edges():
    x = jnp.arange(20.0)
    np.testing.assert_allclose(metrics.kendall_tau(x), 1.0, rtol=1e-6)
    np.testing.assert_allclose(metrics.kendall_tau(-x), -1.0, rtol=1e-6)
    assert metrics.kendall_tau(jnp.ones(20)) == 0
    assert metrics.kendall_tau(jnp.ones(1)) == 0
    assert metrics.kendall_tau(x, 1) == 0


def test_tau_stays_right_for_long_sequences():
    x = jnp.arange(2000) // 2
    expected = scipy.stats.kendalltau(np.arange(2000), np.arange(2000) // 2).statistic
    np.testing.assert_allclose(metrics.kendall_tau(x), expected, rtol=1e-4)


def _alignment_oracle(query, key):
    nearest = [int(np.argmin([((q - k) ** 2).sum() for k in key])) for q in query]
    return scipy.stats.kendalltau(np.arange(len(query)), nearest).statistic


def _noisy_path(seed, num_frames):
    rng = np.random.default_rng(seed)
    path = np.linspace(0, 1, num_frames)[:, None] * np.ones(3)
    return (path + rng.normal(0, 0.1, (num_frames, 3))).astype(np.float32)


def test_mean_alignment_equals_a_loop_over_ordered_pairs_of_unequal_length():
    lengths = [20, 13, 9]
    videos = [_noisy_path(seed, n) for seed, n in enumerate(lengths)]
    padded = jnp.stack([jnp.pad(v, ((0, 20 - len(v)), (0, 0))) for v in videos])
    taus = [
        _alignment_oracle(q, k)
        for i, q in enumerate(videos)
        for j, k in enumerate(videos)
        if i != j
    ]
    mean = jax.jit(metrics.mean_alignment_tau)(padded, jnp.array(lengths))
    np.testing.assert_allclose(mean, np.mean(taus), atol=1e-5)
    assert 0.3 < mean < 1


def test_alignment_is_one_with_itself_and_minus_one_with_its_reverse():
    video = jnp.asarray(_noisy_path(0, 15))
    np.testing.assert_allclose(metrics.alignment_tau(video, video), 1.0, rtol=1e-6)
    np.testing.assert_allclose(metrics.alignment_tau(video, video[::-1]), -1.0, rtol=1e-6)


def test_a_collapsed_latent_aligns_nothing_and_a_single_video_has_no_pair():
    assert metrics.mean_alignment_tau(jnp.zeros((3, 8, 2))) == 0
    assert metrics.mean_alignment_tau(jnp.ones((1, 8, 2))) == 0


def test_reward_against_time_is_one_for_a_rising_reward_whatever_its_shape():
    rising = -jnp.exp(-jnp.arange(12.0))
    np.testing.assert_allclose(metrics.reward_time_tau(rising, 8), 1.0, rtol=1e-6)


def test_separation_ratio_equals_the_loop():
    rng = np.random.default_rng(0)
    reward = -rng.uniform(size=(6, 10))
    success = np.array([True, False, True, False, False, True])
    length = np.array([10, 3, 7, 10, 1, 5])
    cost = [abs(sum(r[:n])) for r, n in zip(reward, length, strict=True)]
    expected = np.mean([c for c, s in zip(cost, success, strict=True) if s]) / np.mean(
        [c for c, s in zip(cost, success, strict=True) if not s]
    )
    ratio = metrics.separation_ratio(
        jnp.asarray(reward, jnp.float32), jnp.asarray(success), jnp.asarray(length)
    )
    np.testing.assert_allclose(ratio, expected, rtol=1e-5)


def test_separation_ratio_ignores_the_scale_and_needs_both_kinds():
    reward = -jnp.arange(1.0, 9.0).reshape(4, 2)
    success = jnp.array([True, True, False, False])
    ratio = metrics.separation_ratio(reward, success)
    assert ratio < 1
    np.testing.assert_allclose(metrics.separation_ratio(9 * reward, success), ratio, rtol=1e-6)
    assert np.isnan(metrics.separation_ratio(reward, jnp.ones(4, bool)))
    assert np.isnan(metrics.separation_ratio(reward, jnp.zeros(4, bool)))


def test_monotonicity_equals_the_loop_and_weighs_falls_by_their_height():
    x = np.random.default_rng(0).normal(size=30).astype(np.float32)
    change = np.diff(x[:20].astype(np.float64))
    found = jax.jit(metrics.monotonicity)(jnp.asarray(x), 20)
    np.testing.assert_allclose(found, change.sum() / np.abs(change).sum(), rtol=1e-5)
    np.testing.assert_allclose(metrics.monotonicity(jnp.asarray(5 * x + 3), 20), found, rtol=1e-4)


def test_monotonicity_at_its_edges():
    rising = jnp.array([0.0, 0.0, 1.0, 5.0])
    np.testing.assert_allclose(metrics.monotonicity(rising), 1.0, rtol=1e-6)
    np.testing.assert_allclose(metrics.monotonicity(-rising), -1.0, rtol=1e-6)
    for flat in (jnp.ones(5), jnp.ones(1), jnp.zeros(5)):
        assert metrics.monotonicity(flat) == 0
    assert metrics.monotonicity(rising, 1) == 0
    for scale in (3e38, 1e-30):
        np.testing.assert_allclose(
            metrics.monotonicity(scale * jnp.array([-1.0, 1.0, 0.0])), 1 / 3, rtol=1e-5
        )


def _marks(frames, size):
    return jnp.zeros(size, bool).at[jnp.array(frames)].set(True)


def _sharpness_loop(reward, boundary, length, window):
    changes = [float(reward[t]) - float(reward[t - 1]) for t in range(1, length)]
    ends = [t for t in range(length) if boundary[t]]
    near = [any(abs(t - e) <= window for e in ends) for t in range(1, length)]
    share = sum(c for c, n in zip(changes, near, strict=True) if n) / sum(map(abs, changes))
    cover = np.mean(near)
    return (share - cover) / (1 - cover)


@pytest.mark.parametrize("length", [40, 31])
@pytest.mark.parametrize("window", [0, 3])
def test_sharpness_equals_the_loop(length, window):
    reward = np.random.default_rng(0).normal(size=40).cumsum().astype(np.float32)
    boundary = _marks([2, 17, 33], 40)
    found = metrics.step_sharpness(jnp.asarray(reward), boundary, length, window=window)
    np.testing.assert_allclose(found, _sharpness_loop(reward, boundary, length, window), rtol=1e-4)


def test_a_staircase_is_sharp_an_even_ramp_is_not_and_a_sawtooth_less_than_either():
    marks = _marks([20, 50], 80)
    stairs = (jnp.arange(80) >= 20) * 1.0 + (jnp.arange(80) >= 50) * 1.0
    np.testing.assert_allclose(metrics.step_sharpness(stairs, marks), 1.0, rtol=1e-5)
    ramp = jnp.linspace(-1.0, 0.0, 80)
    np.testing.assert_allclose(metrics.step_sharpness(ramp, marks), 0.0, atol=1e-4)
    sawtooth = stairs - jnp.arange(80) / 40  # gives back what it wins
    assert metrics.step_sharpness(sawtooth, marks) < 0.6
    np.testing.assert_allclose(metrics.step_sharpness(7 * stairs - 3, marks), 1.0, rtol=1e-5)


def test_sharpness_is_zero_where_it_says_nothing():
    stairs = (jnp.arange(30) >= 20) * 1.0
    assert metrics.step_sharpness(jnp.ones(30), _marks([20], 30)) == 0
    assert metrics.step_sharpness(stairs, jnp.zeros(30, bool)) == 0
    assert metrics.step_sharpness(stairs, jnp.ones(30, bool)) == 0
    assert metrics.step_sharpness(jnp.ones(1), jnp.ones(1, bool)) == 0
    with pytest.raises(ConfigError, match="window is -1"):
        metrics.step_sharpness(stairs, _marks([20], 30), window=-1)


def test_tau_with_ties_equals_scipys_for_rewards_on_a_few_levels():
    for seed in range(5):
        x = np.random.default_rng(seed).choice([-1.0, -0.5, 0.0], 25).astype(np.float32)
        expected = scipy.stats.kendalltau(np.arange(25), x).statistic
        np.testing.assert_allclose(metrics.reward_time_tau(jnp.asarray(x)), expected, atol=1e-6)
