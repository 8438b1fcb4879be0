"""Replay for off-policy learning: a ring buffer of rows that overwrites the oldest.

An insertion writes one window of rows in place, also when seeds are vmapped and when the ring is
carried by a scan. Two things would turn it into a copy of the whole ring. One is a `lax.cond` that
hands the ring on, hence `wanted`. The other is moving rows to make room, hence blocks that divide
the capacity.

Shapes use C for the capacity and R for the rows of one insertion.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int, PRNGKeyArray

from gril_jax.errors import ShapeError


class Replay(NamedTuple):
    """The C newest rows."""

    rows: Any  # leaves (C, ...)
    position: Int[Array, ""]  # where the next rows go
    size: Int[Array, ""]  # rows stored, at most C


def init(row: Any, capacity: int) -> Replay:
    """An empty ring for rows structured like this one, a pytree of arrays or of their shapes."""
    zero = jnp.zeros((), jnp.int32)
    rows = jax.tree.map(lambda x: jnp.zeros((capacity, *x.shape), x.dtype), row)
    return Replay(rows, zero, zero)


def insert(replay: Replay, rows: Any, *, wanted: Bool[Array, ""] | bool = True) -> Replay:
    """Inserts R rows, as many each time, into the ring, overwriting its oldest ones if it is full.

    If they are not `wanted`, the ring comes back as it was, without a copy.

    Raises:
      ShapeError: R does not divide C.
    """
    capacity = jax.tree.leaves(replay.rows)[0].shape[0]
    count = jax.tree.leaves(rows)[0].shape[0]
    if capacity % count:
        raise ShapeError(
            f"{count} rows are inserted into a replay of {capacity}, but must divide that number"
        )

    def put(ring, new):
        old = jax.lax.dynamic_slice_in_dim(ring, replay.position, count, 0)
        new = jnp.where(wanted, new.astype(old.dtype), old)
        return jax.lax.dynamic_update_slice_in_dim(ring, new, replay.position, 0)

    added = jnp.where(wanted, count, 0)
    return Replay(
        rows=jax.tree.map(put, replay.rows, rows),
        position=(replay.position + added) % capacity,
        size=jnp.minimum(replay.size + added, capacity),
    )


def sample(replay: Replay, key: PRNGKeyArray, count: int) -> Any:
    """Samples `count` rows, leaves (count, ...), each from all that are stored.

    Of an empty ring they are zeros. The key is consumed.
    """
    places = jax.random.randint(key, (count,), 0, jnp.maximum(replay.size, 1))
    return jax.tree.map(lambda x: x.at[places].get(mode="promise_in_bounds"), replay.rows)
