"""Soft-DTW as plain loops in float64, and costs to compare it on."""

import jax.numpy as jnp
import numpy as np

__all__ = ["assert_close", "oracle", "random_cost"]


def oracle(cost, gamma, allowed=None):
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


def random_cost(*shape, seed=0):
    rng = np.random.default_rng(seed)
    return jnp.asarray(rng.normal(size=shape) ** 2, jnp.float32)


def assert_close(found, truth, tolerance=1e-5):
    """Within a relative tolerance of the largest number, or of 1 if that is smaller."""
    scale = max(1.0, np.abs(truth).max(initial=0.0))
    np.testing.assert_allclose(found, truth, rtol=0, atol=tolerance * scale)
