"""The interquartile mean and its bootstrap interval against scipy and against all resamples."""

import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

from gril_jax.errors import ConfigError, ShapeError
from gril_jax.metrics.order import interquartile_interval, interquartile_mean

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
