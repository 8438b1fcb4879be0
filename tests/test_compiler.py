import jax
import jax.numpy as jnp
import numpy as np

from gril_jax.compiler import compiled


def test_the_program_computes_what_the_plain_function_does():
    def f(x, y):
        return {"z": jnp.tanh(x @ y).sum(axis=0)}

    x, y = jax.random.normal(jax.random.key(0), (2, 5, 5))
    program = compiled(jax.jit(f).lower(x, y))
    np.testing.assert_allclose(program(x, y)["z"], f(x, y)["z"], rtol=1e-6)
