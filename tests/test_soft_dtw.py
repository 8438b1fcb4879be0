"""Soft-DTW against plain loops in float64, other packages, finite differences and its laws."""

import functools
import inspect
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.errors import ConfigError, GrilError, ShapeError
from gril_jax.losses import (
    expected_alignment,
    pairwise_cost,
    soft_dtw,
    soft_dtw_between,
    soft_dtw_divergence,
)
from gril_jax.losses.soft_dtw_pallas import kernel
from gril_jax.losses.soft_dtw_wavefront import FORBIDDEN, recursion, strip_height


def _oracle(cost, gamma, allowed=None):
    """Value and gradient, one cell after the other, in float64."""
    cost = np.asarray(cost, np.float64)
    rows, columns = cost.shape
    sums = np.full((rows + 1, columns + 1), np.inf)
    sums[0, 0] = 0.0
    weights = np.zeros((rows, columns, 3))
    moves = [(1, 0), (0, 1), (1, 1)]
    for i in range(rows):
        for j in range(columns):
            before = np.array([sums[i + 1 - a, j + 1 - b] for a, b in moves])
            if (allowed is not None and not allowed[i, j]) or np.isinf(before.min()):
                continue
            terms = np.exp((before.min() - before) / gamma)
            sums[i + 1, j + 1] = cost[i, j] + before.min() - gamma * np.log(terms.sum())
            weights[i, j] = terms / terms.sum()
    flow = np.zeros((rows + 1, columns + 1))
    flow[rows, columns] = 1.0
    for i in reversed(range(rows)):
        for j in reversed(range(columns)):
            for (a, b), weight in zip(moves, weights[i, j], strict=True):
                flow[i + 1 - a, j + 1 - b] += weight * flow[i + 1, j + 1]
    return sums[rows, columns], flow[1:, 1:]


def _cost(*shape, seed=0):
    rng = np.random.default_rng(seed)
    return jnp.asarray(rng.normal(size=shape) ** 2, jnp.float32)


def _close(found, truth, tolerance=1e-5):
    """Within a relative tolerance of the largest number, or of 1 if that is smaller."""
    scale = max(1.0, np.abs(truth).max(initial=0.0))
    np.testing.assert_allclose(found, truth, rtol=0, atol=tolerance * scale)


apart = jax.jit(jax.value_and_grad(soft_dtw_between))


@jax.jit
def _both(cost, lengths, other_lengths, gamma):
    value = soft_dtw(cost, lengths, other_lengths, gamma=gamma)
    return value, expected_alignment(cost, lengths, other_lengths, gamma=gamma)


# --- numbers


def test_200_cases_of_unequal_lengths_in_one_program_equal_the_loop():
    rng = np.random.default_rng(0)
    cost = _cost(200, 12, 10)
    rows, columns = rng.integers(1, 13, 200), rng.integers(1, 11, 200)
    gamma = np.resize([1.0, 0.1, 0.01, 0.001], 200)
    arrays = cost, *map(jnp.asarray, (rows, columns, gamma))
    cost, values, flows = map(np.asarray, (cost, *_both(*arrays)))
    for c, n, m, g, value, flow in zip(cost, rows, columns, gamma, values, flows, strict=True):
        true_value, true_flow = _oracle(c[:n, :m], np.float64(np.float32(g)))
        _close(value, true_value)
        _close(flow[:n, :m], true_flow)
        assert not flow[n:].any()
        assert not flow[:, m:].any()


def test_long_sequences_at_small_gamma_keep_five_digits_in_float32():
    cost = _cost(1, 200, 180, seed=1)
    value, flow = _both(cost, jnp.array([200]), jnp.array([180]), jnp.array([0.01]))
    true_value, true_flow = _oracle(cost[0], np.float64(np.float32(0.01)))
    _close(value[0], true_value, 1e-6)
    _close(flow[0], true_flow, 1e-5)


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
        _close(value, true_value)
        _close(flow[: len(query), : len(other)], true_flow)


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
        _close(value, true_value)
        _close(ours, gradient)


# --- derivatives


@jax.jit
def _one(cost, gamma):
    return soft_dtw(cost, gamma=gamma)


def test_the_gradient_is_the_expected_alignment_and_equals_finite_differences():
    cost = _cost(5, 6)
    flow = jax.jit(expected_alignment)(cost, gamma=0.5)
    np.testing.assert_array_equal(jax.grad(_one)(cost, 0.5), flow)
    step = np.zeros((5, 6))
    step[2, 3] = 1e-5
    up, down = (_oracle(np.asarray(cost, np.float64) + s, 0.5)[0] for s in (step, -step))
    assert flow[2, 3] == pytest.approx((up - down) / 2e-5, abs=1e-5)
    assert (flow.sum(axis=0) >= 1 - 1e-6).all()
    assert (flow.sum(axis=1) >= 1 - 1e-6).all()


def test_the_derivative_by_gamma_equals_finite_differences():
    cost = _cost(5, 6)
    up, down = (_oracle(cost, 0.3 + s)[0] for s in (1e-5, -1e-5))
    assert jax.grad(_one, argnums=1)(cost, 0.3) == pytest.approx((up - down) / 2e-5, rel=1e-4)


def test_second_derivatives_are_right_in_every_mode():
    cost = _cost(3, 4)
    forward = jax.jit(jax.jacfwd(jax.grad(_one)))(cost, 0.5)
    reverse = jax.jit(jax.jacrev(jax.grad(_one)))(cost, 0.5)
    step = np.zeros((3, 4))
    step[1, 2] = 1e-5
    up, down = (_oracle(np.asarray(cost, np.float64) + s, 0.5)[1] for s in (step, -step))
    _close(forward[:, :, 1, 2], (up - down) / 2e-5)
    _close(reverse, forward, 1e-6)


def test_bfloat16_gives_float32_values_and_bfloat16_gradients():
    cost = _cost(5, 6).astype(jnp.bfloat16)
    value, gradient = jax.value_and_grad(_one)(cost, 0.1)
    assert (value.dtype, gradient.dtype) == (jnp.float32, jnp.bfloat16)
    true_value, true_flow = _oracle(cost.astype(jnp.float32), np.float64(np.float32(0.1)))
    _close(value, true_value)
    _close(gradient.astype(jnp.float32), true_flow, 2**-8)


# --- transformations


def test_vmap_over_costs_or_gammas_equals_a_loop_also_for_gradients():
    costs, gammas = _cost(3, 5, 6), jnp.array([1.0, 0.1])
    by_gamma = jax.vmap(jax.value_and_grad(_one), in_axes=(None, 0))
    values, flows = jax.jit(jax.vmap(by_gamma, in_axes=(0, None)))(costs, gammas)
    assert flows.shape == (3, 2, 5, 6)
    for i, cost in enumerate(costs):
        for j, gamma in enumerate([1.0, 0.1]):
            true_value, true_flow = _oracle(cost, np.float64(np.float32(gamma)))
            _close(values[i, j], true_value)
            _close(flows[i, j], true_flow)


def test_vmap_makes_lanes_of_one_loop_instead_of_a_loop_of_scalars():
    program = jax.vmap(lambda cost: soft_dtw(cost, gamma=0.1))
    text = str(jax.make_jaxpr(program)(_cost(7, 5, 6)))
    assert "f32[1,1," not in text
    batched = str(jax.make_jaxpr(lambda cost: soft_dtw(cost, gamma=0.1))(_cost(7, 5, 6)))
    assert text.count("scan[") == batched.count("scan[")


in_strips = jax.jit(recursion, static_argnames="height")


@pytest.mark.parametrize("height", [1, 4, 11])
def test_the_order_of_the_loops_changes_no_number(height):
    arguments = _cost(2, 11, 9), jnp.array([0.1, 1.0]), jnp.array([11, 4]), jnp.array([9, 7])
    value, flow = in_strips(*arguments, height=height)
    expected, expected_flow = in_strips(*arguments, height=3)
    _close(value, expected, 1e-6)
    _close(flow, expected_flow, 1e-6)


def test_strips_fill_the_lanes_of_a_cpu_and_are_whole_elsewhere():
    heights = [strip_height(pairs, 100, platform="cpu") for pairs in (1, 16, 64, 4096)]
    assert heights == [100, 32, 8, 1]
    assert strip_height(64, 100, platform="cuda") == 100


# --- masks and bands


def test_padding_does_not_matter_even_if_it_is_nan():
    cost = _cost(6, 7)
    spoilt = cost.at[4:].set(jnp.nan).at[:, 5:].set(jnp.nan)

    @jax.jit
    @jax.value_and_grad
    def value(cost):
        return soft_dtw(cost, 4, 5, gamma=0.1)

    found, gradient = value(spoilt)
    true_value, true_flow = _oracle(cost[:4, :5], np.float64(np.float32(0.1)))
    _close(found, true_value)
    _close(gradient[:4, :5], true_flow)
    assert not gradient[4:].any()
    sequence = _cost(6, 2).at[4:].set(jnp.nan)
    slope = apart(sequence, _cost(5, 2), 4)[1]
    assert np.isfinite(slope).all()


@functools.partial(jax.jit, static_argnames="band")
def _banded(cost, rows, columns, band):
    value = soft_dtw(cost, rows, columns, gamma=0.5, band=band)
    return value, expected_alignment(cost, rows, columns, gamma=0.5, band=band)


@pytest.mark.parametrize(("rows", "columns", "band"), [(6, 7, 1), (7, 4, 0), (3, 7, 2)])
def test_a_band_forbids_cells_far_from_the_line_between_the_corners(rows, columns, band):
    cost = _cost(7, 7)
    offset = np.arange(rows)[:, None] - np.arange(columns)
    low, high = min(rows - columns, 0) - band, max(rows - columns, 0) + band
    allowed = (offset >= low) & (offset <= high)
    true_value, true_flow = _oracle(cost[:rows, :columns], 0.5, allowed)
    value, flow = _banded(cost, rows, columns, band)
    _close(value, true_value)
    _close(flow[:rows, :columns], true_flow)


def test_infinite_costs_forbid_cells_and_a_blocked_pair_stays_finite():
    cost = _cost(4, 4)
    holed = cost.at[1, 1].set(jnp.inf).at[2, 3].set(jnp.inf)
    true_value, true_flow = _oracle(cost, 0.5, np.isfinite(holed))
    value, gradient = jax.value_and_grad(_one)(holed, 0.5)
    _close(value, true_value)
    _close(gradient, true_flow)
    value, gradient = jax.value_and_grad(_one)(jnp.full((4, 4), jnp.inf), 0.5)
    assert value >= FORBIDDEN
    assert np.isfinite(value)
    assert np.isfinite(gradient).all()


def test_empty_sequences_give_zero_with_zero_gradient():
    cost = _cost(3, 4, 5)

    @jax.jit
    def total(cost, lengths, other_lengths):
        values = soft_dtw(cost, lengths, other_lengths, gamma=0.1)
        return values.sum(), values

    lengths = jnp.array([0, 4, 0]), jnp.array([5, 0, 0])
    gradient, values = jax.grad(total, has_aux=True)(cost, *lengths)
    assert values.tolist() == [0, 0, 0]
    assert not gradient.any()
    assert soft_dtw(cost[:0]).shape == (0,)


@pytest.mark.parametrize("scale", [0.0, 1e-20, 1e6, 1e15])
@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (5, 1), (6, 6)])
def test_extreme_costs_and_sizes_have_finite_values_and_gradients(scale, shape):
    query, other = scale * _cost(shape[0], 2), scale * _cost(shape[1], 2, seed=1)
    value, gradient = apart(query, other)
    assert np.isfinite(value)
    assert np.isfinite(gradient).all()


def test_a_traced_gamma_that_is_not_positive_gives_numbers_near_hard_dtw():
    cost = _cost(5, 6)
    value, gradient = jax.value_and_grad(_one)(cost, -1.0)
    _close(value, _oracle(cost, 1e-6)[0])
    assert np.isfinite(gradient).all()


# --- sequences and the divergence


def test_pairwise_cost_is_exact_far_from_the_origin():
    query, other = _cost(4, 3) + 1000.0, _cost(5, 3, seed=1) + 1000.0
    exact = np.asarray(query, np.float64)[:, None] - np.asarray(other, np.float64)[None]
    _close(pairwise_cost(query, other), (exact**2).sum(axis=-1), 1e-6)


def test_the_divergence_is_zero_at_equal_sequences_symmetric_and_above_zero_elsewhere():
    query, other = _cost(4, 6, 3), _cost(4, 6, 3, seed=1)
    run = jax.jit(soft_dtw_divergence)
    assert not run(query, query).any()
    assert (run(query, other) > 0).all()
    _close(run(query, other), run(other, query), 1e-6)
    gradient = jax.jit(jax.grad(lambda x: run(x, query).sum()))(query)
    _close(gradient, np.zeros_like(gradient), 1e-5)
    assert soft_dtw_between(query, query).max() < 0  # which is why the divergence is needed


def test_the_divergence_of_padded_sequences_equals_that_of_short_ones():
    query, other = _cost(2, 6, 3), _cost(2, 6, 3, seed=1)
    padded = jax.jit(soft_dtw_divergence)(query, other, jnp.array([4, 6]), 5)
    _close(padded[0], jax.jit(soft_dtw_divergence)(query[0, :4], other[0, :5]))


# --- the GPU kernel


def test_the_kernel_interpreted_on_a_cpu_equals_the_plain_form():
    cost = _cost(3, 5, 6).at[1, 3:].set(FORBIDDEN).at[1, :, 4:].set(FORBIDDEN)
    arguments = cost, jnp.array([0.1, 1.0, 0.01]), jnp.array([5, 3, 0]), jnp.array([6, 4, 0])
    value, flow = jax.jit(lambda *a: kernel(*a, interpret=True))(*arguments)
    expected, expected_flow = in_strips(*arguments, height=2)
    _close(value, expected, 1e-6)
    _close(flow, expected_flow, 1e-6)
    alone, none = jax.jit(lambda *a: kernel(*a, alignment=False, interpret=True))(*arguments)
    np.testing.assert_array_equal(alone, value)
    assert none is None


@pytest.mark.parametrize("alignment", [True, False])
def test_the_kernel_can_be_lowered_for_cuda(alignment):
    arguments = _cost(3, 70, 90), jnp.ones(3), jnp.full(3, 70), jnp.full(3, 90)
    traced = jax.jit(lambda *a: kernel(*a, alignment=alignment)).trace(*arguments)
    if jax.__version_info__ >= (0, 11) and jax.default_backend() != "gpu":
        pytest.skip("from JAX 0.11 on, lowering a kernel for CUDA needs a GPU in sight")
    assert "triton" in traced.lower(lowering_platforms=("cuda",)).as_text()


def test_importing_the_losses_does_not_import_pallas():
    code = "import gril_jax.losses, sys; assert 'jax.experimental.pallas' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


# --- errors


@pytest.mark.parametrize(
    ("arguments", "options", "kind", "text"),
    [
        ((_cost(3),), {}, ShapeError, r"\(3,\)"),
        ((jnp.zeros((0, 3)),), {}, ShapeError, r"\(0, 3\)"),
        ((_cost(3, 4), 5), {}, ShapeError, "lengths is 5, but must be from 0 to 3"),
        ((_cost(3, 4), None, -1), {}, ShapeError, "other_lengths is -1"),
        ((_cost(3, 4), jnp.array([1, 2])), {}, ShapeError, r"shape \(2,\)"),
        ((_cost(3, 4),), {"gamma": 0.0}, ConfigError, "gamma is 0.0"),
        ((_cost(3, 4),), {"gamma": float("nan")}, ConfigError, "gamma is nan"),
        ((_cost(3, 4),), {"band": -1}, ConfigError, "band is -1"),
        ((_cost(3, 4),), {"implementation": "pallas"}, ConfigError, "needs a CUDA GPU"),
    ],
)
def test_wrong_arguments_are_refused_when_traced(arguments, options, kind, text):
    with pytest.raises(GrilError, match=text) as error:
        inspect.unwrap(soft_dtw)(*arguments, **options)  # as without the tests' type checker
    assert isinstance(error.value, kind)


def test_concrete_lengths_are_checked_inside_jit_too():
    lengths = jnp.array([9])
    with pytest.raises(ShapeError, match="lengths is"):
        jax.jit(lambda cost: soft_dtw(cost, lengths))(_cost(1, 3, 4))


def test_sequences_that_do_not_fit_are_refused():
    with pytest.raises(ShapeError, match=r"\(5, 2\)"):
        inspect.unwrap(pairwise_cost)(_cost(4, 3), _cost(5, 2))
