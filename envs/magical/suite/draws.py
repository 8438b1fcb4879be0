"""Colours and shapes that variants draw, each any of four."""

import jax
import jax.numpy as jnp
from gril_jax.envs.magical.layout import COLOURS
from gril_jax.envs.planar.shapes import SHAPES
from jaxtyping import Array, Int, PRNGKeyArray


def colours(key: PRNGKeyArray, count: int) -> Int[Array, "{count}"]:
    """Independent indices into `COLOURS`."""
    return jax.random.randint(key, (count,), 0, len(COLOURS), jnp.int32)


def shapes(key: PRNGKeyArray, count: int) -> Int[Array, "{count}"]:
    """Independent indices into `SHAPES`."""
    return jax.random.randint(key, (count,), 0, len(SHAPES), jnp.int32)


def each_once(
    key: PRNGKeyArray, drawn: Int[Array, "B"], used: Int[Array, ""] | int
) -> Int[Array, "B"]:
    """Values of which the first `used` have each of 0 to 3 at least once, in random order; the
    others of them are those drawn."""
    values = jnp.concatenate([jnp.arange(4, dtype=jnp.int32), drawn[4:]])
    last = jax.random.uniform(key, drawn.shape) + (jnp.arange(len(drawn)) >= used)
    return values[jnp.argsort(last)]
