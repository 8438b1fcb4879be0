"""Weighted graph pooling (Eqs. 2 and 3 of the paper): many nodes, one latent.

Shapes use N for nodes and D for the node-embedding width. Every function here takes one graph;
batch with `jax.vmap`.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from gril_jax.config.encoder import PoolConfig


def node_weights(
    active: Bool[Array, "N"],
    is_robot: Bool[Array, "N"],
    present: Bool[Array, "N"] | None = None,
    *,
    alpha: Float[Array, ""] | float = PoolConfig.alpha,
    pool_robot: bool = False,
) -> Float[Array, "N"]:
    """Weight of each node in the pooled latent (Eq. 3).

    Args:
      active: nodes that have moved since the episode began.
      is_robot: nodes that belong to the robot. They get weight zero.
      present: False for padding, which gets weight zero; all present if left out.
      alpha: weight of an active node; an idle one has weight 1.
      pool_robot: weigh the robot as any other node (the paper's "with robot" ablation).

    Returns:
      Non-negative weights, not normalised.
    """
    weights = jnp.where(active, jnp.asarray(alpha, jnp.float32), 1.0)
    if not pool_robot:
        weights = jnp.where(is_robot, 0.0, weights)
    return weights if present is None else jnp.where(present, weights, 0.0)


def weighted_pool(z: Float[Array, "N D"], weights: Float[Array, "N"]) -> Float[Array, "D"]:
    """Weighted mean of the node embeddings (Eq. 2).

    A graph whose weights are all zero pools to zeros, with zero gradient, instead of NaN:
    padding and robot-only frames must not poison a batch.

    >>> weighted_pool(jnp.array([[1.0], [3.0]]), jnp.array([1.0, 3.0]))
    Array([2.5], dtype=float32)
    """
    total = jnp.sum(weights)
    return (weights @ z) / jnp.where(total > 0, total, 1.0)
