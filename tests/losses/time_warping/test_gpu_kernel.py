"""The kernel of soft-DTW for GPUs, interpreted on a CPU."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.soft_dtw_oracle import assert_close, random_cost

from gril_jax.losses.time_warping.gpu_kernel import kernel
from gril_jax.losses.time_warping.recursion import FORBIDDEN, recursion

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
