"""Least squares of a few parameters, by Levenberg and Marquardt's method from several starts.

Shapes use P for parameters and C for starts of a search.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

_STEPS = 20


def least(residual: Callable[..., Array], starts: Float[Array, "C P"], *of) -> Float[Array, "P"]:
    """The parameters of least squares, over a search from each of the starts."""

    def one(start, *of):
        cost = lambda params: jnp.sum(residual(params, *of) ** 2)  # noqa: E731

        def step(now, _):
            params, least, damping = now
            slopes, off = jax.jacfwd(residual)(params, *of), residual(params, *of)
            square = slopes.T @ slopes
            square += jnp.diag(damping * jnp.diagonal(square) + 1e-3)
            tried = params - _solved(square, slopes.T @ off)
            costs = cost(tried)
            better = costs < least  # False for what is not finite
            now = jnp.where(better, tried, params), jnp.where(better, costs, least)
            return (*now, damping * jnp.where(better, 0.3, 5.0)), None

        begun = start, cost(start), jnp.float32(0.03)
        return jax.lax.scan(step, begun, length=_STEPS)[0][:2]

    found, costs = jax.vmap(one)(starts, *of)
    return found[jnp.argmin(jnp.where(jnp.isfinite(costs), costs, jnp.inf))]


def _solved(square: Float[Array, "P P"], right: Float[Array, "P"]) -> Float[Array, "P"]:
    """The solution of a few equations, positive definite, by elimination.

    A library's solver would be a call of its own for each step, which no compiler joins to others.
    """
    both = jnp.concatenate([square, right[:, None]], axis=1)
    for k in range(len(right)):
        row = both[k] / both[k, k]
        both = (both - both[:, k : k + 1] * row).at[k].set(row)
    return both[:, -1]
