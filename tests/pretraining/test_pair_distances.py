"""Ranges that find what ends have in common, and the cost of being out of them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from gril_jax.graphs.pair_statistics import KINDS, STATISTICS, pair_statistics
from gril_jax.pretraining import pair_distances

WORDS = jnp.array([[0, 1], [0, 2], [3, 1], [3, 2], [3, 1], [0, 1]])
THERE = jnp.array([True, True, True, True, True, False])


@pytest.fixture(scope="module")
def ranges():
    """Ends whose first statistic is near 1 where frames have anything from 0 to 4, and whose second
    one is near 1 where those with exchanged things have 3; all others are drawn alike."""
    drawn = np.random.default_rng(1)
    shape = (KINDS, STATISTICS)
    ends, frames, exchanged = (drawn.uniform(0, 1, (400, n, *shape)) for n in (1, 20, 8))
    ends[..., 0, :2] = drawn.uniform(0.9, 1.1, (400, 1, 2))
    frames[..., 0, 0] = drawn.uniform(0, 4, (400, 20))
    exchanged[..., 0, :2] = ends[..., 0, :2] + np.array([0.0, 2.0])
    frames[..., 0, 1] = drawn.uniform(0.9, 1.1, (400, 20))
    some = jnp.arange(KINDS) < 4
    share = jnp.full((400, 20), 1 / 8000)
    made = (jnp.asarray(x) for x in (ends[:, 0], frames, share, exchanged))
    return pair_distances.learned(*made, some)


def test_a_statistic_counts_for_what_it_tells(ranges):
    assert float(ranges.weight.sum()) == pytest.approx(1.0)
    assert float(ranges.weight[0, :2].sum()) > 0.9
    assert (ranges.weight[0, :2] > 0.3).all()  # told by frames, and by what changed its place
    assert not ranges.weight[4].any()  # a kind without pairs
    assert 0.85 < ranges.nearest[0, 0] < 0.92 < 1.08 < ranges.furthest[0, 0] < 1.15


def test_what_is_out_of_its_range_costs(ranges):
    half = jnp.float32(0.2)
    inside = (ranges.nearest + ranges.furthest) / 2
    cost = lambda x: float(  # noqa: E731
        pair_distances.beyond(ranges, inside.at[0, 0].set(x), half, 0.7)
    )
    assert cost(1.0) == cost(0.95) == 0.0
    weight = float(ranges.weight[0, 0])
    worst = weight / float(ranges.weight.max())
    far = float(ranges.furthest[0, 0])
    one = 0.7 + 0.3 * 0.5 / 0.5
    assert cost(far + 0.5) == pytest.approx((0.2 * weight + 0.8 * worst) * one, rel=1e-3)
    assert 0.0 < cost(far + 0.02) < cost(far + 0.05) < cost(far + 0.5)


def test_slopes_agree_with_finite_differences(ranges):
    cost = jax.jit(
        lambda center: pair_distances.beyond(
            ranges, pair_statistics(center, WORDS, THERE)[0], jnp.float32(0.2), 0.7
        )
    )
    center = jax.random.uniform(jax.random.key(2), (6, 2), minval=-1, maxval=1)
    check_grads(cost, (center,), order=1, modes=["rev"], atol=2e-2, rtol=2e-2)
