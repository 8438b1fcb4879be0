import runpy

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.compilation import compiler
from gril_jax.compilation.compiler import compiled


def _f(x, y):
    return {"z": jnp.tanh(x @ y).sum(axis=0)}


@pytest.mark.parametrize("brief", [False, True])
def test_the_program_computes_what_the_plain_function_does(brief):
    x, y = jax.random.normal(jax.random.key(0), (2, 5, 5))
    program = compiled(jax.jit(_f).lower(x, y), brief=brief)
    np.testing.assert_allclose(program(x, y)["z"], _f(x, y)["z"], rtol=1e-6)


def test_xla_knows_the_options_of_every_device():
    x = jnp.ones((5, 5))
    lowered = jax.jit(_f).lower(x, x)
    own = runpy.run_path(compiler.__file__)  # tests/conftest.py has put aside those of CPUs
    assert own["_OPTIONS"]["cpu"]
    for options in (own["_OPTIONS"], own["_BRIEF"]):
        for one in options.values():
            lowered.compile(compiler_options=one)
    with pytest.raises(jax.errors.JaxRuntimeError, match="xla_gpu_lunch"):
        lowered.compile(compiler_options={"xla_gpu_lunch": True})
