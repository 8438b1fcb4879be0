"""Blocks of environments that never mix, so that devices with whole blocks exchange nothing.

Whatever takes environments out of their order (minibatches, starts from a pool) does so within
blocks of them. The number of blocks depends on those of environments and minibatches, not on the
devices. So the same numbers are sampled on any number of devices.

Shapes use B for environments, K for blocks, L = B / K for those of one, and M for minibatches.
"""

import math
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int, PRNGKeyArray

_MOST = 64  # devices that one seed may usefully be spread over
_LEAST = 256  # environments of a block: enough of them to be shuffled among


def count(num_envs: int, minibatches: int = 1) -> int:
    """The number K of blocks, a power of two.

    Each has `_LEAST` environments or more, if there are so many, and divides evenly into its
    minibatches. Their number M divides that of environments.
    """
    most = min(_MOST, max(1, num_envs // _LEAST))
    return math.gcd(2 ** (most.bit_length() - 1), num_envs // minibatches)


def split(tree: Any, blocks: int) -> Any:
    """Leaves (B, ...) as (K, L, ...); K, here `blocks`, divides B."""
    # Not with -1, which an array without elements, as in a simulator's state, leaves open.
    return jax.tree.map(lambda x: x.reshape(blocks, len(x) // blocks, *x.shape[1:]), tree)


def join(tree: Any) -> Any:
    """Leaves (K, L, ...) as (B, ...)."""
    return jax.tree.map(lambda x: x.reshape(math.prod(x.shape[:2]), *x.shape[2:]), tree)


def minibatches(tree: Any, key: PRNGKeyArray, number: int) -> Any:
    """Leaves (B, ...) shuffled into (M, B / M, ...): each minibatch gets a share of each block.

    `number` is M, a divisor of B. The key is consumed.
    """
    num_envs = len(jax.tree.leaves(tree)[0])
    blocks = count(num_envs, number)
    order = jnp.argsort(jax.random.bits(key, (blocks, num_envs // blocks)))
    return jax.tree.map(lambda x: _deal(x, order, number), split(tree, blocks))


def _deal(x: Array, order: Int[Array, "K L"], number: int) -> Array:
    blocks = len(order)
    dealt = jax.vmap(lambda rows, order: rows[order])(x, order)
    dealt = dealt.reshape(blocks, number, -1, *x.shape[2:])
    return jnp.swapaxes(dealt, 0, 1).reshape(number, -1, *x.shape[2:])
