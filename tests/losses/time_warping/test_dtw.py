"""Hard DTW against a plain loop and every path, its ties, its path and soft-DTW's limit."""

import inspect
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax import losses
from gril_jax.errors import ShapeError
from gril_jax.losses import dtw_path

path, dtw = jax.jit(dtw_path), jax.jit(losses.dtw, static_argnames="band")


def _cost(*shape, seed=0):
    return jnp.asarray(np.random.default_rng(seed).normal(size=shape) ** 2, jnp.float32)


def _paths(rows, columns):
    """Every monotone path between the corners."""
    if (rows, columns) == (1, 1):
        return [[(0, 0)]]
    found = []
    for a, b in ((1, 0), (0, 1), (1, 1)):
        if rows > a and columns > b:
            before = _paths(rows - a, columns - b)
            found.extend([*p, (rows - 1, columns - 1)] for p in before)
    return found


@pytest.mark.parametrize("seed", range(5))
def test_value_and_path_are_those_of_the_best_of_all_paths(seed):
    cost = _cost(4, 5, seed=seed)
    truth = np.asarray(cost, np.float64)
    best = min(_paths(4, 5), key=lambda p: sum(truth[c] for c in p))
    value, cells = path(cost)
    assert value == pytest.approx(sum(truth[c] for c in best), rel=1e-6)
    assert [tuple(c) for c in cells.tolist() if c[0] >= 0] == best
    assert not (cells[len(best) :] + 1).any()


def test_the_gradient_is_one_on_the_path_and_zero_elsewhere():
    cost = _cost(6, 4)
    gradient = np.zeros((6, 4))
    for i, j in path(cost)[1].tolist():
        if i >= 0:
            gradient[i, j] = 1.0
    np.testing.assert_array_equal(jax.grad(dtw)(cost), gradient)


def test_paths_of_equal_cost_are_settled_for_the_diagonal():
    cells = path(jnp.zeros((3, 3)))[1]
    assert cells.tolist() == [[0, 0], [1, 1], [2, 2], [-1, -1], [-1, -1]]


def test_it_is_the_limit_of_soft_dtw():
    cost = _cost(3, 9, 8)

    @jax.jit
    def both(cost):
        hard = jax.vmap(jax.value_and_grad(losses.dtw))(cost)
        soft = losses.soft_dtw(cost, gamma=1e-4), losses.expected_alignment(cost, gamma=1e-4)
        return hard, soft

    (hard, slope), (soft, flow) = both(cost)
    np.testing.assert_allclose(hard, soft, rtol=1e-5)
    np.testing.assert_allclose(slope, flow, atol=1e-4)


def test_vmapped_paths_of_padded_pairs_equal_those_of_short_ones():
    cost = _cost(2, 6, 7)
    rows, columns = jnp.array([4, 6]), jnp.array([7, 3])
    values, cells = jax.jit(jax.vmap(dtw_path))(cost, rows, columns)
    for i, (n, m) in enumerate([(4, 7), (6, 3)]):
        value, short = path(cost[i, :n, :m])
        assert values[i] == pytest.approx(value)
        np.testing.assert_array_equal(cells[i, : len(short)], short)


def test_a_band_of_zero_leaves_the_diagonal_alone():
    cost = _cost(5, 5)
    assert dtw(cost, band=0) == pytest.approx(float(jnp.trace(cost)), rel=1e-6)


def test_an_empty_pair_has_no_path_and_value_zero():
    value, cells = path(_cost(3, 4), 0, 2)
    assert value == 0
    assert (cells == -1).all()


def test_each_step_of_a_path_moves_by_at_most_one():
    cells = [c for c in path(_cost(20, 15))[1].tolist() if c[0] >= 0]
    assert cells[0] == [0, 0]
    assert cells[-1] == [19, 14]
    moves = {(b[0] - a[0], b[1] - a[1]) for a, b in itertools.pairwise(cells)}
    assert moves <= {(0, 1), (1, 0), (1, 1)}


def test_a_batch_is_refused_by_the_path():
    with pytest.raises(ShapeError, match=r"\(2, 3, 4\)"):
        inspect.unwrap(dtw_path)(_cost(2, 3, 4))  # as without the tests' type checker
