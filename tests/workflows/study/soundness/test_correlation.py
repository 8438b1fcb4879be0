"""Rank correlations beside SciPy's, and their bootstrap beside a plain loop."""

import numpy as np
import pytest
from scipy.stats import spearmanr

from gril_jax.workflows.study.soundness.soundness import correlation, spearman


@pytest.fixture(scope="module")
def data():
    draw = np.random.default_rng(1)
    success = np.round(draw.uniform(size=25), 1)  # with ties
    return success + 0.3 * draw.normal(size=25), success, draw.normal(size=25)


def test_the_correlation_is_scipys_row_by_row(data):
    x = np.stack(data)
    found = spearman(x, x[[1, 1, 0]])
    wanted = [spearmanr(a, b).statistic for a, b in zip(x, x[[1, 1, 0]], strict=True)]
    np.testing.assert_allclose(found, wanted, rtol=1e-12)


def test_it_depends_on_ranks_alone(data):
    assert spearman(np.exp(data[0]), data[1] ** 3) == pytest.approx(spearman(data[0], data[1]))


def test_what_does_not_vary_has_no_correlation():
    assert np.isnan(spearman(np.ones(4), np.arange(4.0)))


def test_the_interval_and_the_comparison_are_those_of_a_loop_over_samples(data):
    figure, success, rival = data
    found = correlation(-figure, success, rival, sign=-1, draws=200)
    chosen = np.random.default_rng(0).integers(25, size=(200, 25))
    own = [spearmanr(-figure[i], success[i]).statistic for i in chosen]
    other = [spearmanr(rival[i], success[i]).statistic for i in chosen]
    assert found.rho == pytest.approx(spearmanr(-figure, success).statistic)
    np.testing.assert_allclose([found.low, found.high], np.quantile(own, [0.025, 0.975]))
    assert found.better == np.mean([-a > b for a, b in zip(own, other, strict=True)])
    assert found.better > 0.9
    assert found.count == 25


def test_an_undefined_figure_ranks_as_the_worst(data):
    figure, success, rival = (x.copy() for x in data)
    for sign in (1, -1):
        figure[3] = np.nan
        found = correlation(figure, success, rival, sign=sign, draws=50)
        figure[3] = -sign * 1e9
        assert found == correlation(figure, success, rival, sign=sign, draws=50)


def test_an_encoder_without_a_policy_is_left_out(data):
    figure, success, rival = (x.copy() for x in data)
    success[0] = np.nan
    found = correlation(figure, success, rival, draws=50)
    assert found == correlation(figure[1:], success[1:], rival[1:], draws=50)
    assert found.count == 24


@pytest.mark.parametrize("success", [np.zeros(6), np.full(6, np.nan), np.arange(1.0)])
def test_of_equal_or_too_few_successes_nothing_is_known(success):
    figure = np.arange(float(len(success)))
    found = correlation(figure, success, figure, draws=20)
    assert np.isnan([found.rho, found.low, found.high, found.better]).all()
