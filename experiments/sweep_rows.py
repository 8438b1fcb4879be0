"""What a sweep is made of: rows, one configuration with one seed each, and arrays of many rows."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from gril_jax.config import RunConfig

__all__ = ["Row", "keys", "stack"]


class Row(NamedTuple):
    """One policy to train."""

    cell: int
    seed: int
    config: RunConfig


def keys(seeds: Sequence[int], stream: int):
    """The keys that a run of each seed by itself uses."""
    return jax.vmap(lambda s: jax.random.fold_in(jax.random.key(s), stream))(jnp.array(seeds))


def stack(trees: Sequence[Any]) -> Any:
    return jax.tree.map(lambda *x: jnp.stack(x), *trees)
