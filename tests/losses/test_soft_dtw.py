"""Soft-DTW against plain loops in float64, other packages, finite differences and its laws."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.soft_dtw_oracle import assert_close, oracle, random_cost

from gril_jax.losses import (
    expected_alignment,
    pairwise_cost,
    soft_dtw,
    soft_dtw_between,
    soft_dtw_divergence,
)
from gril_jax.losses.recursion import recursion, strip_height


@jax.jit
def _both(cost, lengths, other_lengths, gamma):
    value = soft_dtw(cost, lengths, other_lengths, gamma=gamma)
    return value, expected_alignment(cost, lengths, other_lengths, gamma=gamma)


# --- numbers


def test_200_cases_of_unequal_lengths_in_one_program_equal_the_loop():
    rng = np.random.default_rng(0)
    cost = random_cost(200, 12, 10)
    rows, columns = rng.integers(1, 13, 200), rng.integers(1, 11, 200)
    gamma = np.resize([1.0, 0.1, 0.01, 0.001], 200)
    arrays = cost, *map(jnp.asarray, (rows, columns, gamma))
    cost, values, flows = map(np.asarray, (cost, *_both(*arrays)))
    for c, n, m, g, value, flow in zip(cost, rows, columns, gamma, values, flows, strict=True):
        true_value, true_flow = oracle(c[:n, :m], np.float64(np.float32(g)))
        assert_close(value, true_value)
        assert_close(flow[:n, :m], true_flow)
        assert not flow[n:].any()
        assert not flow[:, m:].any()


def test_long_sequences_at_small_gamma_keep_five_digits_in_float32():
    cost = random_cost(1, 200, 180, seed=1)
    value, flow = _both(cost, jnp.array([200]), jnp.array([180]), jnp.array([0.01]))
    true_value, true_flow = oracle(cost[0], np.float64(np.float32(0.01)))
    assert_close(value[0], true_value, 1e-6)
    assert_close(flow[0], true_flow, 1e-5)


def _sequences(seed):
    rng = np.random.default_rng(seed)
    rows, columns = rng.choice([2, 14]), rng.choice([3, 9])  # few shapes: a peer compiles each
    return rng.normal(size=(rows, 3)), rng.normal(size=(columns, 3))


def _padded(sequences):
    whole = max(map(len, sequences))
    return np.stack([np.pad(s, ((0, whole - len(s)), (0, 0))) for s in sequences])


@pytest.fixture(scope="module")
def double_precision():
    """200 pairs of sequences with our values and gradients by the cost, all in float64."""
    queries, others = zip(*map(_sequences, range(200)), strict=True)
    gamma = np.resize([1.0, 0.1, 0.01], 200)
    with jax.enable_x64(True):
        lengths = [jnp.array([len(s) for s in sequences]) for sequences in (queries, others)]
        arrays = [jnp.asarray(_padded(sequences)) for sequences in (queries, others)]
        cost = pairwise_cost(*arrays, *lengths)
        values, flows = (np.asarray(x) for x in _both(cost, *lengths, jnp.asarray(gamma)))
    assert values.dtype == np.float64
    return queries, others, gamma, values, flows


def test_200_random_cases_equal_tslearn(double_precision):
    metrics = pytest.importorskip("tslearn.metrics")
    for query, other, gamma, value, flow in zip(*double_precision, strict=True):
        true_flow, true_value = metrics.soft_dtw_alignment(query, other, gamma=gamma)
        assert_close(value, true_value)
        assert_close(flow[: len(query), : len(other)], true_flow)


def test_200_random_cases_equal_ott(double_precision):
    costs = pytest.importorskip("ott.geometry.costs")

    @jax.jit
    def peer(query, other, gamma):
        return jax.value_and_grad(lambda x: costs.SoftDTW(gamma=gamma)(x, other))(query)

    for query, other, gamma, value, flow in zip(*double_precision, strict=True):
        with jax.enable_x64(True):
            true_value, gradient = peer(jnp.asarray(query), jnp.asarray(other), gamma)
        # OTT differentiates by the sequence; the chain rule brings our gradient there.
        flow = flow[: len(query), : len(other)]
        ours = 2 * (flow.sum(axis=1)[:, None] * query - flow @ other)
        assert_close(value, true_value)
        assert_close(ours, gradient)


# --- derivatives


@jax.jit
def _one(cost, gamma):
    return soft_dtw(cost, gamma=gamma)


def test_the_gradient_is_the_expected_alignment_and_equals_finite_differences():
    cost = random_cost(5, 6)
    flow = jax.jit(expected_alignment)(cost, gamma=0.5)
    np.testing.assert_array_equal(jax.grad(_one)(cost, 0.5), flow)
    step = np.zeros((5, 6))
    step[2, 3] = 1e-5
    up, down = (oracle(np.asarray(cost, np.float64) + s, 0.5)[0] for s in (step, -step))
    assert flow[2, 3] == pytest.approx((up - down) / 2e-5, abs=1e-5)
    assert (flow.sum(axis=0) >= 1 - 1e-6).all()
    assert (flow.sum(axis=1) >= 1 - 1e-6).all()


def test_the_derivative_by_gamma_equals_finite_differences():
    cost = random_cost(5, 6)
    up, down = (oracle(cost, 0.3 + s)[0] for s in (1e-5, -1e-5))
    assert jax.grad(_one, argnums=1)(cost, 0.3) == pytest.approx((up - down) / 2e-5, rel=1e-4)


@pytest.mark.parametrize("scale", [1.0, 30.0])
def test_the_derivative_by_a_small_gamma_keeps_five_digits_in_float32(scale):
    """(value - <alignment, cost>) / gamma would have lost per cents."""
    cost = scale * jnp.asarray(np.random.default_rng(0).uniform(size=(40, 40)), jnp.float32)
    gammas = scale * jnp.array([0.1, 0.01, 0.003], jnp.float32)
    found = jax.vmap(jax.grad(_one, argnums=1), in_axes=(None, 0))(cost, gammas)
    for gamma, slope in zip(np.float64(gammas), found, strict=True):
        step = 1e-4 * gamma
        up, down, up2, down2 = (oracle(cost, gamma + n * step)[0] for n in (1, -1, 2, -2))
        differences = (8 * (up - down) - (up2 - down2)) / (12 * step)  # of fourth order
        assert float(slope) == pytest.approx(differences, rel=1e-5)


def test_the_derivative_by_gamma_and_by_cost_at_once_and_again():
    cost, gamma = random_cost(4, 5), jnp.float32(0.3)
    both = jax.grad(_one, argnums=(0, 1))(cost, gamma)
    assert_close(both[0], jax.grad(_one)(cost, gamma), 1e-6)
    by_gamma = jax.grad(_one, argnums=1)
    assert_close(both[1], by_gamma(cost, gamma), 1e-6)
    mixed = jax.grad(by_gamma)(cost, gamma)
    assert_close(mixed, jax.jacfwd(jax.grad(_one), argnums=1)(cost, gamma), 1e-5)
    assert_close(
        jax.grad(by_gamma, argnums=1)(cost, gamma),
        jax.jacfwd(by_gamma, argnums=1)(cost, gamma),
        1e-5,
    )
    forbidden = cost.at[1].set(jnp.inf).at[1, 0].set(0.0)
    assert np.isfinite(by_gamma(forbidden, 1e-6))


def test_second_derivatives_are_right_in_every_mode():
    cost = random_cost(3, 4)
    forward = jax.jit(jax.jacfwd(jax.grad(_one)))(cost, 0.5)
    reverse = jax.jit(jax.jacrev(jax.grad(_one)))(cost, 0.5)
    step = np.zeros((3, 4))
    step[1, 2] = 1e-5
    up, down = (oracle(np.asarray(cost, np.float64) + s, 0.5)[1] for s in (step, -step))
    assert_close(forward[:, :, 1, 2], (up - down) / 2e-5)
    assert_close(reverse, forward, 1e-6)


def test_bfloat16_gives_float32_values_and_bfloat16_gradients():
    cost = random_cost(5, 6).astype(jnp.bfloat16)
    value, gradient = jax.value_and_grad(_one)(cost, 0.1)
    assert (value.dtype, gradient.dtype) == (jnp.float32, jnp.bfloat16)
    true_value, true_flow = oracle(cost.astype(jnp.float32), np.float64(np.float32(0.1)))
    assert_close(value, true_value)
    assert_close(gradient.astype(jnp.float32), true_flow, 2**-8)


# --- transformations


def test_vmap_over_costs_or_gammas_equals_a_loop_also_for_gradients():
    costs, gammas = random_cost(3, 5, 6), jnp.array([1.0, 0.1])
    by_gamma = jax.vmap(jax.value_and_grad(_one), in_axes=(None, 0))
    values, flows = jax.jit(jax.vmap(by_gamma, in_axes=(0, None)))(costs, gammas)
    assert flows.shape == (3, 2, 5, 6)
    for i, cost in enumerate(costs):
        for j, gamma in enumerate([1.0, 0.1]):
            true_value, true_flow = oracle(cost, np.float64(np.float32(gamma)))
            assert_close(values[i, j], true_value)
            assert_close(flows[i, j], true_flow)


def test_vmap_makes_lanes_of_one_loop_instead_of_a_loop_of_scalars():
    program = jax.vmap(lambda cost: soft_dtw(cost, gamma=0.1))
    text = str(jax.make_jaxpr(program)(random_cost(7, 5, 6)))
    assert "f32[1,1," not in text
    batched = str(jax.make_jaxpr(lambda cost: soft_dtw(cost, gamma=0.1))(random_cost(7, 5, 6)))
    assert text.count("scan[") == batched.count("scan[")


in_strips = jax.jit(recursion, static_argnames="height")


@pytest.mark.parametrize("height", [1, 4, 11])
def test_the_order_of_the_loops_changes_no_number(height):
    arguments = random_cost(2, 11, 9), jnp.array([0.1, 1.0]), jnp.array([11, 4]), jnp.array([9, 7])
    value, flow = in_strips(*arguments, height=height)
    expected, expected_flow = in_strips(*arguments, height=3)
    assert_close(value, expected, 1e-6)
    assert_close(flow, expected_flow, 1e-6)


def test_strips_fill_the_lanes_of_a_cpu_and_are_whole_elsewhere():
    heights = [strip_height(pairs, 100, platform="cpu") for pairs in (1, 16, 64, 4096)]
    assert heights == [100, 64, 16, 1]
    assert strip_height(64, 100, platform="cuda") == 100


# --- sequences and the divergence


def test_pairwise_cost_is_exact_far_from_the_origin():
    query, other = random_cost(4, 3) + 1000.0, random_cost(5, 3, seed=1) + 1000.0
    exact = np.asarray(query, np.float64)[:, None] - np.asarray(other, np.float64)[None]
    assert_close(pairwise_cost(query, other), (exact**2).sum(axis=-1), 1e-6)


def test_the_divergence_is_zero_at_equal_sequences_symmetric_and_above_zero_elsewhere():
    query, other = random_cost(4, 6, 3), random_cost(4, 6, 3, seed=1)
    run = jax.jit(soft_dtw_divergence)
    assert not run(query, query).any()
    assert (run(query, other) > 0).all()
    assert_close(run(query, other), run(other, query), 1e-6)
    gradient = jax.jit(jax.grad(lambda x: run(x, query).sum()))(query)
    assert_close(gradient, np.zeros_like(gradient), 1e-5)
    assert soft_dtw_between(query, query).max() < 0  # which is why the divergence is needed


def test_the_divergence_of_padded_sequences_equals_that_of_short_ones():
    query, other = random_cost(2, 6, 3), random_cost(2, 6, 3, seed=1)
    padded = jax.jit(soft_dtw_divergence)(query, other, jnp.array([4, 6]), 5)
    assert_close(padded[0], jax.jit(soft_dtw_divergence)(query[0, :4], other[0, :5]))


@pytest.mark.parametrize("size", [1e18, 1e20, 1e30, 3e38, np.inf])
def test_features_of_any_size_have_a_finite_value_and_gradient(size):
    x, y = (jax.random.normal(jax.random.key(seed), (6, 3)) for seed in (0, 1))
    for loss in (soft_dtw_between, soft_dtw_divergence):
        both = jax.jit(jax.value_and_grad(loss))
        for other in (y, y * size, x * size):
            value, slope = both(x * size, other)
            assert np.isfinite(value)
            assert np.isfinite(slope).all()
