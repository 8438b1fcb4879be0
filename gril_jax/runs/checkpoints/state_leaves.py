"""The leaves of a state on the host: their names, their arrays, and one digest of them all.

Typed keys count as their data, beside the name of their generator.
"""

import hashlib
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np


class Leaf(NamedTuple):
    """One leaf, as a checkpoint holds it."""

    path: str  # such as "params.policy.0", or "(root)"
    key: str | None  # the generator of a typed key, or None for any other leaf
    array: np.ndarray  # owns its memory


def host_copy(state: Any) -> list[Leaf]:
    """The leaves of a pytree copied to the host, so that its buffers may be donated right after."""
    leaves = jax.tree_util.tree_leaves_with_path(state)
    # All at once, so that the transfers overlap. On a CPU they are views of JAX's own buffers.
    arrays = jax.device_get([_array(leaf) for _, leaf in leaves])
    return [
        Leaf(leaf_name(path), key_kind(leaf), np.array(array))
        for (path, leaf), array in zip(leaves, arrays, strict=True)
    ]


def digest(state: Any) -> str:
    """SHA-256 over the names, kinds and bits of a state's leaves, in hexadecimal."""
    total = hashlib.sha256()
    for leaf in host_copy(state):
        head = (leaf.path, leaf.key, leaf.array.dtype.name, leaf.array.shape)
        total.update(repr(head).encode())
        total.update(np.ascontiguousarray(leaf.array).tobytes())
    return total.hexdigest()


def like_of(leaf: Any) -> tuple[str | None, str, tuple[int, ...]]:
    """A leaf's generator, dtype and shape, as `host_copy` would give them, without its values."""
    packed = jax.eval_shape(_array, leaf)
    return key_kind(leaf), packed.dtype.name, packed.shape


def to_device(array: np.ndarray, like: Any) -> jax.Array:
    """Puts a leaf's array on the default device; as a key if `like` is one."""
    return wrapped(jnp.array(array), like)  # a copy: a donated buffer must not be NumPy's


def leaf_name(path: Sequence[Any]) -> str:
    """A leaf's path as text, such as "params.policy.0"."""
    return jax.tree_util.keystr(tuple(path), simple=True, separator=".") or "(root)"


def key_kind(leaf: Any) -> str | None:
    """The generator of a typed key, or None for any other leaf."""
    return str(jax.random.key_impl(leaf)) if is_key(leaf) else None


def data_of(leaf: Any) -> Any:
    """A leaf, or the data of one that is a typed key."""
    return jax.random.key_data(leaf) if is_key(leaf) else leaf


def _array(leaf: Any) -> Any:
    return jnp.asarray(data_of(leaf))


def wrapped(data: Any, like: Any) -> Any:
    """Data as a typed key if another leaf is one."""
    return jax.random.wrap_key_data(data, impl=jax.random.key_impl(like)) if is_key(like) else data


def is_key(leaf: Any) -> bool:
    """True for an array of typed keys."""
    return isinstance(leaf, jax.Array) and jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
