"""Kendall's tau and means over seeds against scipy, alignment and cycles against plain loops."""

import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

from gril_jax import metrics
from gril_jax.errors import ConfigError, ShapeError
from gril_jax.metrics.order import interquartile_interval, interquartile_mean


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
    np.testing.assert_allclose(metrics.kendall_tau(rising, 8), 1.0, rtol=1e-6)


two_way = jax.jit(metrics.two_way_cycle_consistency)


def _path(seed, num_frames):
    rng = np.random.default_rng(seed)
    path = np.linspace(0, 1, num_frames)[:, None] * np.ones(3)
    return (path + rng.normal(0, 0.1, (num_frames, 3))).astype(np.float32)


def _nearest(query, key):
    return np.array([int(np.argmin([((q - k) ** 2).sum() for k in key])) for q in query])


def _home(videos, route):
    """Frames of the first video that are within one frame of themselves after the route."""
    frames = np.arange(len(videos[route[0]]))
    for u, v in itertools.pairwise(route):
        frames = _nearest(videos[u], videos[v])[frames]
    return np.abs(frames - np.arange(len(frames))) <= 1


@pytest.mark.parametrize("seed", range(3))
def test_it_equals_loops_over_videos_of_unequal_length(seed):
    lengths = [9, 13, 7, 11]
    videos = [_path(10 * seed + k, n) for k, n in enumerate(lengths)]
    padded = np.full((4, 13, 3), np.nan, np.float32)
    for row, frames in zip(padded, videos, strict=True):
        row[: len(frames)] = frames
    arguments = jnp.asarray(padded), jnp.array(lengths)
    pairs = [_home(videos, (u, v, u)).mean() for u, v in itertools.permutations(range(4), 2)]
    np.testing.assert_allclose(two_way(*arguments), np.mean(pairs), rtol=1e-6)
    assert 0 < two_way(*arguments) <= 1


def test_equal_videos_are_consistent_and_a_collapsed_latent_is_not():
    equal = jnp.tile(jnp.asarray(_path(0, 12)), (3, 1, 1))
    assert two_way(equal) == 1
    collapsed = jnp.zeros((3, 12, 2))  # all go to frame 0, which is home for frames 0 and 1
    np.testing.assert_allclose(two_way(collapsed), 2 / 12, rtol=1e-6)


def test_too_few_videos_and_empty_ones_count_for_nothing():
    videos = jnp.stack([jnp.asarray(_path(k, 8)) for k in range(3)])
    assert two_way(videos[:1]) == 0
    lengths = jnp.array([8, 8, 0])
    np.testing.assert_allclose(two_way(videos, lengths), two_way(videos[:2]), rtol=1e-6)


interval = jax.jit(interquartile_interval, static_argnames="num_resamples")


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5, 7, 8, 10, 33])
def test_the_mean_equals_scipys_trimmed_mean(size):
    scores = np.random.default_rng(size).normal(size=size).astype(np.float32)
    expected = scipy.stats.trim_mean(scores.astype(np.float64), 0.25)
    np.testing.assert_allclose(
        interquartile_mean(jnp.asarray(scores)), expected, rtol=1e-5, atol=1e-6
    )


def _trimmed(x, axis):
    return scipy.stats.trim_mean(x, 0.25, axis=axis)


@pytest.mark.parametrize("confidence", [0.95, 0.8])
def test_the_interval_equals_scipys_percentile_bootstrap(confidence):
    scores = np.random.default_rng(0).normal(size=12).astype(np.float32)
    options = {"method": "percentile", "confidence_level": confidence, "n_resamples": 20_000}
    expected = scipy.stats.bootstrap(
        (scores,), _trimmed, rng=np.random.default_rng(1), **options
    ).confidence_interval
    found = interval(
        jax.random.key(0), jnp.asarray(scores), confidence=confidence, num_resamples=20_000
    )
    np.testing.assert_allclose(found, [expected.low, expected.high], atol=0.03)


def test_the_interval_of_three_runs_is_that_of_all_resamples():
    scores = np.array([0.0, 1.0, 5.0], np.float32)
    means = [np.mean(drawn) for drawn in itertools.product(scores, repeat=3)]
    expected = np.quantile(means, [0.25, 0.75], method="nearest")
    found = interval(jax.random.key(0), jnp.asarray(scores), confidence=0.5, num_resamples=5000)
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_runs_are_drawn_again_within_each_task():
    scores = jnp.array([[0.0, 10.0], [0.0, 10.0], [0.0, 10.0]])  # nothing varies within a task
    np.testing.assert_allclose(interval(jax.random.key(0), scores), [5.0, 5.0])


def test_the_interval_moves_and_stretches_with_the_scores():
    scores = jnp.asarray(np.random.default_rng(0).normal(size=9), jnp.float32)
    low, high = interval(jax.random.key(0), scores)
    np.testing.assert_allclose(
        interval(jax.random.key(0), 3 * scores + 1), [3 * low + 1, 3 * high + 1], rtol=1e-4
    )
    assert low <= interquartile_mean(scores) <= high


def test_one_run_has_an_interval_of_no_width_and_nan_is_not_cut_off():
    np.testing.assert_array_equal(
        interval(jax.random.key(0), jnp.array([0.7])), jnp.array([0.7, 0.7])
    )
    assert np.isnan(interquartile_mean(jnp.array([0.0, 1.0, 2.0, jnp.nan])))


def test_what_does_not_fit_is_named():
    refused = functools.partial(interquartile_interval, jax.random.key(0))
    with pytest.raises(ConfigError, match=r"confidence is 95.0; it must be between 0 and 1"):
        refused(jnp.ones(3), confidence=95.0)
    with pytest.raises(ConfigError, match="num_resamples is 0"):
        refused(jnp.ones(3), num_resamples=0)
    with pytest.raises(ShapeError, match=r"scores has shape \(0,\)"):
        refused(jnp.ones(0))
    with pytest.raises(ShapeError, match="at least one score"):
        interquartile_mean(jnp.ones(0))
