"""The benchmark of the tasks counts episodes whose numbers are finite."""

import jax.numpy as jnp
from gril_jax.experiments.bench import env as bench_env


def test_an_episode_with_a_number_that_is_not_finite_does_not_count():
    states = {"x": jnp.ones((4, 3)).at[1, 2].set(jnp.nan), "n": jnp.arange(4)}
    assert bench_env._finite(states) == 0.75
    assert bench_env._finite(states | {"y": jnp.ones(4).at[3].set(jnp.inf)}) == 0.5
