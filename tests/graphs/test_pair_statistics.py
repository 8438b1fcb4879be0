"""Statistics of pairs against NumPy and SciPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.sparse.csgraph import minimum_spanning_tree

from gril_jax.graphs.pair_statistics import STATISTICS, pair_statistics

WORDS = jnp.array(
    [[0, 1], [0, 2], [3, 1], [3, 2], [3, 1], [0, 1]]
)  # three of a colour, four shapes
THERE = jnp.array([True, True, True, True, True, False])
OF = jax.jit(pair_statistics)


def _kinds(one, other):
    same = np.asarray(WORDS)[one] == np.asarray(WORDS)[other]
    return True, same[0], not same[0], same[1], not same[1]


def test_statistics_of_each_kind():
    center = np.random.default_rng(0).uniform(-1, 1, (6, 2))
    found, count = OF(jnp.asarray(center, jnp.float32), WORDS, THERE)
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
    found, count = OF(jnp.ones((6, 2)), WORDS, jnp.arange(6) == 2)
    assert not count.any()
    np.testing.assert_allclose(found, 0.0, atol=1e-6)


@pytest.mark.parametrize("objects", [0, 1])
def test_fewer_than_two_objects_have_no_pairs(objects):
    found, count = OF(jnp.ones((objects, 2)), WORDS[:objects], THERE[:objects])
    assert found.shape == (5, STATISTICS)
    assert not found.any()
    assert not count.any()


def test_a_bend_is_wider_than_a_line_and_two_heaps_have_a_longer_link_than_one():
    line = jnp.array([[0.0, 0.0], [0.3, 0.0], [0.6, 0.0], [0.9, 0.0], [0.0, 0.0], [0.0, 0.0]])
    bend = line.at[2:4, 1].set(0.2)
    apart = line.at[2:4, 0].add(0.4)
    there = jnp.arange(6) < 4
    of = lambda center: np.asarray(OF(center, WORDS, there)[0][0])  # noqa: E731
    narrow, link = STATISTICS - 3, STATISTICS - 1
    assert of(line)[narrow] == pytest.approx(0.0, abs=1e-3)
    assert of(bend)[narrow] > 0.05
    assert of(line)[link] == pytest.approx(0.3)
    assert of(apart)[link] == pytest.approx(0.7)


def test_slopes_are_finite_where_all_lies_in_one_point():
    total = lambda center: pair_statistics(center, WORDS, THERE)[0].sum()  # noqa: E731
    slope = jax.jit(jax.grad(total))(jnp.zeros((6, 2)))
    assert np.isfinite(slope).all()
