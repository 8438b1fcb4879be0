"""Statistics of pairs against NumPy and SciPy, and ranges that find what ends have in common."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from scipy.sparse.csgraph import minimum_spanning_tree

from gril_jax.pretraining import pair_distances

WORDS = jnp.array(
    [[0, 1], [0, 2], [3, 1], [3, 2], [3, 1], [0, 1]]
)  # three of a colour, four shapes
THERE = jnp.array([True, True, True, True, True, False])
STATISTICS = jax.jit(pair_distances.statistics)


def _kinds(one, other):
    same = np.asarray(WORDS)[one] == np.asarray(WORDS)[other]
    return True, same[0], not same[0], same[1], not same[1]


def test_statistics_of_each_kind():
    center = np.random.default_rng(0).uniform(-1, 1, (6, 2))
    found, count = STATISTICS(jnp.asarray(center, jnp.float32), WORDS, THERE)
    present = np.flatnonzero(THERE)
    pairs = [(i, j) for i in present for j in present if i < j]
    for kind in range(5):
        chosen = [pair for pair in pairs if _kinds(*pair)[kind]]
        ways = np.array([center[i] - center[j] for i, j in chosen])
        distance = np.linalg.norm(ways, axis=1)
        levels = np.quantile(distance, np.linspace(0, 1, 5))
        squares = np.linalg.eigvalsh(ways.T @ ways / len(ways))
        gaps = np.zeros((6, 6))
        for (i, j), d in zip(chosen, distance, strict=True):
            gaps[i, j] = d
        link = minimum_spanning_tree(gaps).toarray().max()
        wanted = [*levels, *np.sqrt(squares), link]
        assert count[kind] == len(chosen)
        np.testing.assert_allclose(found[kind], wanted, atol=2e-3)


def test_without_pairs_there_is_nothing():
    found, count = STATISTICS(jnp.ones((6, 2)), WORDS, jnp.arange(6) == 2)
    assert not count.any()
    np.testing.assert_allclose(found, 0.0, atol=1e-6)


def test_a_bend_is_wider_than_a_line_and_two_heaps_have_a_longer_link_than_one():
    line = jnp.array([[0.0, 0.0], [0.3, 0.0], [0.6, 0.0], [0.9, 0.0], [0.0, 0.0], [0.0, 0.0]])
    bend = line.at[2:4, 1].set(0.2)
    apart = line.at[2:4, 0].add(0.4)
    there = jnp.arange(6) < 4
    of = lambda center: np.asarray(STATISTICS(center, WORDS, there)[0][0])  # noqa: E731
    narrow, link = pair_distances.STATISTICS - 3, pair_distances.STATISTICS - 1
    assert of(line)[narrow] == pytest.approx(0.0, abs=1e-3)
    assert of(bend)[narrow] > 0.05
    assert of(line)[link] == pytest.approx(0.3)
    assert of(apart)[link] == pytest.approx(0.7)


@pytest.fixture(scope="module")
def ranges():
    """Ends whose first statistic is near 1 where frames have anything from 0 to 4; all others are
    drawn alike for ends and frames."""
    drawn = np.random.default_rng(1)
    shape = (pair_distances.KINDS, pair_distances.STATISTICS)
    ends, frames = drawn.uniform(0, 1, (400, *shape)), drawn.uniform(0, 1, (400, 20, *shape))
    ends[:, 0, 0] = drawn.uniform(0.9, 1.1, 400)
    frames[..., 0, 0] = drawn.uniform(0, 4, (400, 20))
    some = jnp.arange(pair_distances.KINDS) < 4
    share = jnp.full((400, 20), 1 / 8000)
    return pair_distances.learned(jnp.asarray(ends), jnp.asarray(frames), share, some)


def test_a_statistic_counts_for_what_it_tells(ranges):
    assert float(ranges.weight.sum()) == pytest.approx(1.0)
    assert float(ranges.weight[0, 0]) > 0.9
    assert not ranges.weight[4].any()  # a kind without pairs
    assert 0.85 < ranges.nearest[0, 0] < 0.92 < 1.08 < ranges.furthest[0, 0] < 1.15


def test_what_is_out_of_its_range_costs(ranges):
    half = jnp.float32(0.2)
    cost = lambda x: float(  # noqa: E731
        pair_distances.beyond(ranges, jnp.full_like(ranges.weight, 0.5).at[0, 0].set(x), half, 0.7)
    )
    assert cost(1.0) == cost(0.95) == 0.0
    weight = float(ranges.weight[0, 0])
    far = float(ranges.furthest[0, 0])
    assert cost(far + 0.5) == pytest.approx(weight * (0.7 + 0.3 * 0.5 / 0.5), rel=1e-3)
    assert 0.0 < cost(far + 0.02) < cost(far + 0.05) < cost(far + 0.5)


def test_slopes_agree_with_finite_differences(ranges):
    cost = jax.jit(
        lambda center: pair_distances.beyond(
            ranges, pair_distances.statistics(center, WORDS, THERE)[0], jnp.float32(0.2), 0.7
        )
    )
    center = jax.random.uniform(jax.random.key(2), (6, 2), minval=-1, maxval=1)
    check_grads(cost, (center,), order=1, modes=["rev"], atol=2e-2, rtol=2e-2)


def test_slopes_are_finite_where_all_lies_in_one_point(ranges):
    total = lambda center: pair_distances.statistics(center, WORDS, THERE)[0].sum()  # noqa: E731
    slope = jax.jit(jax.grad(total))(jnp.zeros((6, 2)))
    assert np.isfinite(slope).all()
