"""What a sweep is made of: rows, one configuration with one seed each, and arrays of many rows."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from gril_jax.config import RunConfig
from gril_jax.config.grid import with_seed

from .named_rows import Rows, changed

__all__ = ["Row", "keys", "stack", "with_seeds"]


class Row(NamedTuple):
    """One policy to train."""

    cell: int
    seed: int
    config: RunConfig


def with_seeds(config: RunConfig, changes: Rows, seeds: int) -> list[Row]:
    """Each row of a table, a change of the configuration, with this many seeds."""
    return [
        Row(cell, seed, with_seed(changed(config, change), seed))
        for cell, change in enumerate(changes.values())
        for seed in range(seeds)
    ]


def keys(seeds: Sequence[int], stream: int):
    """The keys that a run of each seed by itself uses."""
    return jax.vmap(lambda s: jax.random.fold_in(jax.random.key(s), stream))(jnp.array(seeds))


def stack(trees: Sequence[Any]) -> Any:
    return jax.tree.map(lambda *x: jnp.stack(x), *trees)
