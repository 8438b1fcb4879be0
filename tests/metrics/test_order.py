"""Kendall's tau against scipy, and alignment against a plain loop."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

from gril_jax import metrics


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
