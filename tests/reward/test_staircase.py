"""Stages of one reward, against a plain loop and by what they must not pay."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.reward import staircase

LEVEL = jnp.array([-0.6, -0.2, 0.3, 0.0])  # the third was found in few demonstrations
KEPT = jnp.array([True, True, False, True])
STAIRS = staircase.from_levels(LEVEL, KEPT)


@jax.jit
def _run(stairs, values):
    def one(progress, value):
        progress, paid = staircase.step(stairs, progress, value)
        return progress, (paid, progress.index)

    return jax.lax.scan(one, staircase.init(), values)[1]


def _oracle(least, level, values):
    """One frame after the other, in float64."""
    index, floor, paid, indices = 0, -np.inf, [], []
    for value in values:
        paid.append(max(value, floor))
        if index < len(least) and value >= least[index]:
            if index < len(least) - 1:
                floor = max(paid[-1], level[index])
            index += 1
        indices.append(index)
    return np.array(paid), np.array(indices)


def test_levels_that_count_become_stages_three_quarters_of_the_way_up():
    assert int(STAIRS.count) == 3
    np.testing.assert_allclose(STAIRS.least[:3], [-0.7, -0.3, -0.05], atol=1e-6)


def test_random_walks_equal_the_loop():
    walks = np.random.default_rng(0).normal(-0.9, 0.3, (20, 40)).astype(np.float32)
    paid, index = jax.vmap(_run, (None, 0))(STAIRS, jnp.asarray(walks))
    assert len(np.unique(index[:, -1])) > 1
    for row, values in enumerate(walks):
        ends = (np.asarray(x[:3], np.float64) for x in (STAIRS.least, STAIRS.level))
        wanted = _oracle(*ends, values.astype(np.float64))
        np.testing.assert_allclose(paid[row], wanted[0], atol=1e-6)
        np.testing.assert_array_equal(index[row], wanted[1])


def test_undoing_costs_nothing_in_a_stage_and_all_of_it_after_the_last():
    values = jnp.array([-1.0, -0.6, -0.9, -0.25, -0.9, 0.0, -0.9])
    paid, index = _run(STAIRS, values)
    assert index.tolist() == [0, 1, 1, 2, 2, 3, 3]
    np.testing.assert_allclose(paid, [-1, -0.6, -0.6, -0.25, -0.2, 0, -0.2], atol=1e-6)


def test_to_better_what_is_done_brings_nothing_and_what_is_better_is_kept():
    """From three quarters of a step up to its end, and beyond that end."""
    paid, _ = _run(STAIRS, jnp.array([-1.0, -0.68, -0.65, -0.6, -0.55]))
    np.testing.assert_allclose(paid, [-1, -0.68, -0.6, -0.6, -0.55], atol=1e-6)
    paid, _ = _run(STAIRS, jnp.array([-1.0, -0.5, -0.65]))
    np.testing.assert_allclose(paid, [-1, -0.5, -0.5], atol=1e-6)


def test_without_levels_there_is_one_stage():
    stairs = staircase.from_levels(LEVEL, jnp.zeros(4, bool))
    paid, index = _run(stairs, jnp.array([-1.0, -0.2, 0.0, -0.5]))
    assert int(stairs.count) == 1
    assert index.tolist() == [0, 1, 1, 1]
    assert paid.tolist() == pytest.approx([-1.0, -0.2, 0.0, -0.5])


def test_padding_changes_nothing():
    longer = staircase.from_levels(jnp.append(LEVEL, 0.5), jnp.append(KEPT, False))
    values = jnp.linspace(-1, 0, 30)
    for one, other in zip(_run(STAIRS, values), _run(longer, values), strict=True):
        np.testing.assert_array_equal(one, other)
