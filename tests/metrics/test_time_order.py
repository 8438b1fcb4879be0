"""Correlations of reward and time, against scipy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

from gril_jax import metrics

ORACLES = {
    metrics.voc_pearson: scipy.stats.pearsonr,
    metrics.voc_spearman: scipy.stats.spearmanr,
}
BOTH = pytest.mark.parametrize("one", ORACLES)
JITTED = {one: jax.jit(one) for one in ORACLES}


def _traces(levels):
    """Four padded videos and their lengths; few levels make ties."""
    draw = np.random.default_rng(levels)
    reward = draw.integers(0, levels, (4, 40)) / levels - 1 + np.linspace(0, 0.5, 40)
    if levels < 10:
        reward = reward.round(1)
    return jnp.asarray(reward, jnp.float32), jnp.array([40, 17, 5, 2])


@BOTH
@pytest.mark.parametrize("levels", [3, 1000])
def test_each_equals_scipy_with_and_without_ties_at_any_length(one, levels):
    reward, length = _traces(levels)
    for row, n in zip(reward, length, strict=True):
        expected = ORACLES[one](np.arange(n), row[:n]).statistic
        spoiled = jnp.where(jnp.arange(40) < n, row, jnp.nan)
        np.testing.assert_allclose(JITTED[one](row, n), expected, atol=2e-6)
        np.testing.assert_allclose(JITTED[one](spoiled, n), expected, atol=2e-6)


@BOTH
def test_what_has_no_order_is_zero(one):
    assert one(jnp.full(30, -0.1)) == 0  # whose mean in float32 is not exactly -0.1
    assert one(jnp.ones(1)) == 0
    assert JITTED[one](jnp.arange(40.0), 1) == 0
    assert JITTED[one](jnp.arange(40.0), 0) == 0


@BOTH
def test_the_scale_of_a_reward_does_not_matter(one):
    reward = _traces(1000)[0][0]
    for scale in (1e-30, 1e30):
        np.testing.assert_allclose(one(scale * reward), one(reward), atol=2e-6)
    np.testing.assert_allclose(one(-reward), -one(reward), atol=2e-6)


def test_ranks_see_the_order_alone_and_pearson_the_shape():
    steep = -jnp.exp(-jnp.arange(30.0) / 3)
    np.testing.assert_allclose(metrics.voc_spearman(steep), 1.0, rtol=1e-6)
    assert 0.3 < metrics.voc_pearson(steep) < 0.7


def test_rounding_breaks_no_ties():
    draw = np.random.default_rng(0)
    steps = np.repeat([-1.0, -0.7, -0.2, 0.0], [15, 6, 4, 5])
    noisy = jnp.asarray(steps + 1e-6 * draw.normal(size=30), jnp.float32)
    padded = jnp.pad(noisy, (0, 4), constant_values=jnp.nan)
    merged = jax.jit(metrics.merge_ties)(padded, 30)
    np.testing.assert_allclose(merged[:30], steps, atol=1e-5)
    assert len(np.unique(merged[:30])) == 4
    exact, found = (metrics.time_order(x[None]) for x in (jnp.asarray(steps, jnp.float32), noisy))
    np.testing.assert_allclose(found, exact, atol=1e-5)
    assert exact.reward_time_tau - metrics.kendall_tau(noisy) > 0.1  # what rounding would do
    distinct = _traces(1000)[0][0]
    np.testing.assert_array_equal(metrics.merge_ties(distinct), distinct)


def test_the_order_of_several_videos_is_the_mean_over_them():
    reward, length = _traces(3)
    found = jax.jit(metrics.time_order)(reward, length)
    videos = [row[:n] for row, n in zip(reward, length, strict=True)]
    oracles = (*ORACLES.values(), scipy.stats.kendalltau)
    for value, oracle in zip(found, oracles, strict=True):
        expected = np.mean([oracle(np.arange(len(x)), x).statistic for x in videos])
        np.testing.assert_allclose(value, expected, atol=2e-6)
    whole = metrics.time_order(reward)
    np.testing.assert_allclose(whole.voc_pearson, jax.vmap(metrics.voc_pearson)(reward).mean())
