"""Ranking of trajectories, against loops over tuples and pairs, and against scipy."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

from gril_jax import metrics

policy_ranking = jax.jit(metrics.policy_ranking)
preference_accuracy = jax.jit(metrics.preference_accuracy)


def _tau_a(scores):
    """Of scores whose ranks are 0, 1, 2 ..."""
    pairs = itertools.combinations(scores, 2)
    return np.mean([np.sign(later - earlier) for earlier, later in pairs])


def _ranking(score, rank, group):
    """Every tuple of one trajectory of each rank, as Robometer's evaluation does."""
    found = []
    for one in np.unique(group):
        levels = [score[(group == one) & (rank == r)] for r in np.unique(rank[group == one])]
        if len(levels) > 1:
            found.append(np.mean([_tau_a(chosen) for chosen in itertools.product(*levels)]))
    return np.mean(found)


def _preferred(score, rank, group):
    at = itertools.permutations(range(len(score)), 2)
    pairs = [(i, j) for i, j in at if group[i] == group[j] and rank[i] > rank[j]]
    return np.mean([score[i] > score[j] for i, j in pairs])


@pytest.mark.parametrize("levels", [3, 1000])
def test_both_equal_loops_over_groups_of_unequal_size_with_and_without_ties(levels):
    draw = np.random.default_rng(levels)
    rank, group = draw.integers(0, 3, 24), np.sort(draw.integers(0, 3, 24))
    rank[group == 2] = 1  # a group in which nothing can be compared
    score = (draw.integers(0, levels, 24) + rank * levels / 4).astype(np.float32)
    expected = _ranking(score, rank, group)
    np.testing.assert_allclose(policy_ranking(score, rank, group), expected, atol=1e-6)
    expected = _preferred(score, rank, group)
    np.testing.assert_allclose(preference_accuracy(score, rank, group), expected, atol=1e-6)


def test_one_trajectory_of_each_rank_gives_kendalls_tau():
    score, rank = jax.random.normal(jax.random.key(0), 9), jnp.arange(9)
    expected = scipy.stats.kendalltau(rank, score).statistic
    np.testing.assert_allclose(metrics.policy_ranking(score, rank), expected, atol=1e-6)


def test_every_rank_counts_the_same_however_many_trajectories_it_has():
    score, rank = jnp.array([0.0, 0.0, 0.0, 5.0, 1.0]), jnp.array([0, 0, 0, 1, 2])
    np.testing.assert_allclose(metrics.policy_ranking(score, rank), 1 / 3, rtol=1e-6)
    np.testing.assert_allclose(metrics.preference_accuracy(score, rank), 6 / 7, rtol=1e-6)


def test_of_successes_and_failures_it_is_the_area_and_ties_count_as_said():
    score, success = jnp.array([0.3, 0.1, 0.1, -2.0]), jnp.array([True, True, False, False])
    area = metrics.success_auc(score, success)
    rank = success.astype(int)
    np.testing.assert_allclose(metrics.policy_ranking(score, rank), 2 * area - 1, rtol=1e-6)
    assert area == 0.875
    assert metrics.preference_accuracy(score, rank) == 0.75
    equal = jnp.zeros(4)
    assert metrics.policy_ranking(equal, rank) == 0
    assert metrics.preference_accuracy(equal, rank) == 0


def test_without_a_pair_that_can_be_compared_both_are_undefined():
    for rank, group in (([1, 1], [0, 0]), ([0, 1], [0, 1]), ([1], [0])):
        for one in (metrics.policy_ranking, metrics.preference_accuracy):
            assert np.isnan(one([0.0, 1.0][: len(rank)], rank, group))
