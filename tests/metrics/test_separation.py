"""Measures of success against failure, beside plain loops."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.metrics.separation import CONVENTIONS, cumulative, ratio, stage_order, success_auc

REWARD = -jax.random.uniform(jax.random.key(0), (6, 12))
LENGTH = jnp.array([12, 5, 1, 7, 12, 3])
SUCCESS = jnp.array([True, False, True, False, False, True])

sums = jax.jit(cumulative, static_argnames="convention")


def _oracle(reward, length, convention):
    own = np.asarray(reward)[:length]
    if convention == "natural":
        return own.sum()
    if convention == "resampled":
        return own.mean() * len(reward)
    return own.sum() + (len(reward) - length) * own[-1]


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_sums_are_those_of_a_loop_over_recordings(convention):
    expected = [_oracle(r, n, convention) for r, n in zip(REWARD, LENGTH, strict=True)]
    np.testing.assert_allclose(sums(REWARD, LENGTH, convention=convention), expected, rtol=1e-5)


def test_conventions_agree_on_recordings_of_full_length_and_ignore_padding():
    full = jnp.full(6, 12)
    values = [sums(REWARD, full, convention=c) for c in CONVENTIONS]
    np.testing.assert_allclose(values[0], values[1], rtol=1e-6)
    np.testing.assert_allclose(values[0], values[2], rtol=1e-6)
    spoiled = jnp.where(jnp.arange(12) < LENGTH[:, None], REWARD, jnp.nan)
    for c in CONVENTIONS:
        np.testing.assert_array_equal(
            sums(spoiled, LENGTH, convention=c), sums(REWARD, LENGTH, convention=c)
        )


def test_the_ratio_of_natural_sums_equals_the_loop_ignores_the_scale_and_needs_both_kinds():
    cost = [abs(sum(map(float, r[:n]))) for r, n in zip(REWARD, LENGTH, strict=True)]
    expected = np.mean([c for c, s in zip(cost, SUCCESS, strict=True) if s]) / np.mean(
        [c for c, s in zip(cost, SUCCESS, strict=True) if not s]
    )
    totals = sums(REWARD, LENGTH, convention="natural")
    np.testing.assert_allclose(ratio(totals, SUCCESS), expected, rtol=1e-5)
    np.testing.assert_allclose(ratio(9 * totals, SUCCESS), expected, rtol=1e-5)
    assert np.isnan(ratio(jnp.ones(3), jnp.ones(3, bool)))
    assert np.isnan(ratio(jnp.ones(3), jnp.zeros(3, bool)))


def test_the_area_is_the_share_of_pairs_that_are_in_order():
    score = jnp.array([0.3, 0.1, 0.1, -2.0, 0.3, 5.0])
    pairs = [
        1.0 if a > b else 0.5 if a == b else 0.0 for a in score[SUCCESS] for b in score[~SUCCESS]
    ]
    np.testing.assert_allclose(success_auc(score, SUCCESS), np.mean(pairs), rtol=1e-6)
    np.testing.assert_allclose(success_auc(-score, SUCCESS), 1 - np.mean(pairs), rtol=1e-6)
    np.testing.assert_allclose(success_auc(jnp.exp(score), SUCCESS), np.mean(pairs), rtol=1e-6)
    assert np.isnan(success_auc(jnp.ones(3), jnp.zeros(3, bool)))


def test_order_of_stages_is_somers_d_of_a_loop_over_pairs():
    stage, reward = jnp.array([0, 0, 1, 1, 1, 2, 3, 3, 3, 3, 3, 3]), REWARD[0]
    for length in (12, 7, 2):
        signs = [
            np.sign(reward[j] - reward[i])
            for i in range(length)
            for j in range(length)
            if stage[i] < stage[j]
        ]
        expected = np.mean(signs) if signs else 0.0
        found = stage_order(reward, stage, length)
        np.testing.assert_allclose(found, expected, atol=1e-6)
    assert float(stage_order(jnp.arange(12.0), stage)) == 1.0
