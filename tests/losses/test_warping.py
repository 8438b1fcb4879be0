"""Soft-DTW at its edges: padding, forbidden cells, empty and extreme input, errors."""

import inspect
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.soft_dtw_oracle import assert_close, oracle, random_cost

from gril_jax.errors import ConfigError, GrilError, ShapeError
from gril_jax.losses import pairwise_cost, soft_dtw, soft_dtw_between
from gril_jax.losses.gpu_kernel import kernel
from gril_jax.losses.recursion import FORBIDDEN, recursion

apart = jax.jit(jax.value_and_grad(soft_dtw_between))


@jax.jit
def _one(cost, gamma):
    return soft_dtw(cost, gamma=gamma)


# --- masks


def test_padding_does_not_matter_even_if_it_is_nan():
    cost = random_cost(6, 7)
    spoilt = cost.at[4:].set(jnp.nan).at[:, 5:].set(jnp.nan)

    @jax.jit
    @jax.value_and_grad
    def value(cost):
        return soft_dtw(cost, 4, 5, gamma=0.1)

    found, gradient = value(spoilt)
    true_value, true_flow = oracle(cost[:4, :5], np.float64(np.float32(0.1)))
    assert_close(found, true_value)
    assert_close(gradient[:4, :5], true_flow)
    assert not gradient[4:].any()
    sequence = random_cost(6, 2).at[4:].set(jnp.nan)
    slope = apart(sequence, random_cost(5, 2), 4)[1]
    assert np.isfinite(slope).all()


def test_infinite_costs_forbid_cells_and_a_blocked_pair_stays_finite():
    cost = random_cost(4, 4)
    holed = cost.at[1, 1].set(jnp.inf).at[2, 3].set(jnp.inf)
    true_value, true_flow = oracle(cost, 0.5, np.isfinite(holed))
    value, gradient = jax.value_and_grad(_one)(holed, 0.5)
    assert_close(value, true_value)
    assert_close(gradient, true_flow)
    value, gradient = jax.value_and_grad(_one)(jnp.full((4, 4), jnp.inf), 0.5)
    assert value >= FORBIDDEN
    assert np.isfinite(value)
    assert np.isfinite(gradient).all()


def test_empty_sequences_give_zero_with_zero_gradient():
    cost = random_cost(3, 4, 5)

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
    query, other = scale * random_cost(shape[0], 2), scale * random_cost(shape[1], 2, seed=1)
    value, gradient = apart(query, other)
    assert np.isfinite(value)
    assert np.isfinite(gradient).all()


def test_a_traced_gamma_that_is_not_positive_gives_numbers_near_hard_dtw():
    cost = random_cost(5, 6)
    value, gradient = jax.value_and_grad(_one)(cost, -1.0)
    assert_close(value, oracle(cost, 1e-6)[0])
    assert np.isfinite(gradient).all()


# --- errors


@pytest.mark.parametrize(
    ("arguments", "options", "kind", "text"),
    [
        ((random_cost(3),), {}, ShapeError, r"\(3,\)"),
        ((jnp.zeros((0, 3)),), {}, ShapeError, r"\(0, 3\)"),
        ((random_cost(3, 4), 5), {}, ShapeError, "lengths is 5, but must be from 0 to 3"),
        ((random_cost(3, 4), None, -1), {}, ShapeError, "other_lengths is -1"),
        ((random_cost(3, 4), jnp.array([1, 2])), {}, ShapeError, r"shape \(2,\)"),
        ((random_cost(3, 4),), {"gamma": 0.0}, ConfigError, "gamma is 0.0"),
        ((random_cost(3, 4),), {"gamma": float("nan")}, ConfigError, "gamma is nan"),
        ((random_cost(3, 4),), {"implementation": "pallas"}, ConfigError, "needs a CUDA GPU"),
    ],
)
def test_wrong_arguments_are_refused_when_traced(arguments, options, kind, text):
    with pytest.raises(GrilError, match=text) as error:
        inspect.unwrap(soft_dtw)(*arguments, **options)  # as without the tests' type checker
    assert isinstance(error.value, kind)


def test_concrete_lengths_are_checked_inside_jit_too():
    lengths = jnp.array([9])
    with pytest.raises(ShapeError, match="lengths is"):
        jax.jit(lambda cost: soft_dtw(cost, lengths))(random_cost(1, 3, 4))


def test_sequences_that_do_not_fit_are_refused():
    with pytest.raises(ShapeError, match=r"\(5, 2\)"):
        inspect.unwrap(pairwise_cost)(random_cost(4, 3), random_cost(5, 2))


# --- The kernel of soft-DTW for GPUs, interpreted on a CPU

in_strips = jax.jit(recursion, static_argnames="height")


def test_the_kernel_interpreted_on_a_cpu_equals_the_plain_form():
    cost = random_cost(3, 5, 6).at[1, 3:].set(FORBIDDEN).at[1, :, 4:].set(FORBIDDEN)
    arguments = cost, jnp.array([0.1, 1.0, 0.01]), jnp.array([5, 3, 0]), jnp.array([6, 4, 0])
    value, flow = jax.jit(lambda *a: kernel(*a, interpret=True))(*arguments)
    expected, expected_flow = in_strips(*arguments, height=2)
    assert_close(value, expected, 1e-6)
    assert_close(flow, expected_flow, 1e-6)
    alone, none = jax.jit(lambda *a: kernel(*a, alignment=False, interpret=True))(*arguments)
    np.testing.assert_array_equal(alone, value)
    assert none is None


@pytest.mark.parametrize("alignment", [True, False])
def test_the_kernel_can_be_lowered_for_cuda(alignment):
    arguments = random_cost(3, 70, 90), jnp.ones(3), jnp.full(3, 70), jnp.full(3, 90)
    traced = jax.jit(lambda *a: kernel(*a, alignment=alignment)).trace(*arguments)
    if jax.__version_info__ >= (0, 11) and jax.default_backend() != "gpu":
        pytest.skip("from JAX 0.11 on, lowering a kernel for CUDA needs a GPU in sight")
    assert "triton" in traced.lower(lowering_platforms=("cuda",)).as_text()


def test_importing_the_losses_does_not_import_pallas():
    code = "import gril_jax.losses, sys; assert 'jax.experimental.pallas' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
