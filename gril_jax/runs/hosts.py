"""Several processes that run one program: what the first one does alone, and what all agree on.

    hosts.initialize(cluster)                  # before anything else touches JAX
    reward_params = hosts.same_everywhere(reward_params)
    if hosts.is_first(): ...                   # the run's folder, the terminal

Every process computes, on the same inputs, and calls these functions in the same order: most of
them wait for all processes. In a process by itself each of them is a no-op.
"""

import contextlib
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import SingleDeviceSharding

from gril_jax.errors import RunError

from .checkpoints.state_leaves import data_of, wrapped


def initialize(cluster: Mapping[str, Any], *, timeout_s: int = 300) -> None:
    """Connects the processes of the job of `cluster_of`; then `jax.devices()` lists those of all. A
    RunError if the others cannot be reached, or JAX has been used already."""
    # JAX's own handler would swallow SIGTERM, at which a run is saved.
    jax.config.update("jax_enable_preemption_service", False)
    jax.config.update("jax_cpu_collectives_implementation", "gloo")
    try:
        jax.distributed.initialize(**cluster, initialization_timeout=timeout_s)
    except (RuntimeError, ValueError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise RunError(f"the processes of the job cannot be connected ({reason})") from None


def is_first() -> bool:
    """True in the process that writes the run's folder, prints and draws."""
    return jax.process_index() == 0


def same_everywhere(tree: Any) -> Any:
    """Broadcasts the first process's values bit for bit, as NumPy arrays; typed keys stay keys.

    Of the other processes' trees, only shapes and types are looked at.
    """
    if jax.process_count() == 1:
        return tree

    def sent(leaf):
        like = jax.eval_shape(data_of, leaf)
        values = data_of(leaf) if is_first() else np.zeros(like.shape, like.dtype)
        # As bytes, because the processes' contributions are added up: -0.0 + 0.0 is not -0.0.
        flat = np.asarray(values, like.dtype).reshape(-1).view(np.uint8)
        sent = multihost_utils.broadcast_one_to_all(flat)
        return wrapped(np.asarray(sent).view(like.dtype).reshape(like.shape), leaf)

    return jax.tree.map(sent, tree)


def largest(numbers: Sequence[int]) -> list[int]:
    """The maximum of each number over all processes."""
    if jax.process_count() == 1:
        return [int(x) for x in numbers]
    every = multihost_utils.process_allgather(np.asarray(numbers, np.int32))
    return [int(x) for x in every.max(axis=0)]


def gathered(tree: Any) -> Any:
    """The tree with arrays that are spread over processes as whole NumPy arrays in each of them;
    one leaf after the other is whole on a device meanwhile."""

    def whole(leaf):
        if not isinstance(leaf, jax.Array) or leaf.is_fully_addressable:
            return leaf
        return wrapped(multihost_utils.process_allgather(data_of(leaf), tiled=True), leaf)

    return jax.tree.map(whole, tree)


def placed_like(tree: Any, like: Any) -> Any:
    """Places whole arrays like those of another tree; on a single device they stay as they are."""

    def place(leaf, old):
        if not isinstance(old, jax.Array) or isinstance(old.sharding, SingleDeviceSharding):
            return leaf
        host, where = np.asarray(data_of(leaf)), data_of(old).sharding
        placed = jax.make_array_from_callback(host.shape, where, lambda index: host[index])
        return wrapped(placed, old)

    return jax.tree.map(place, tree, like)


@contextlib.contextmanager
def scratch() -> Iterator[Path | None]:
    """A temporary folder for files of processes other than the first, which are not kept; None in
    the first."""
    if is_first():
        yield None
        return
    with tempfile.TemporaryDirectory(prefix="gril-") as folder:
        yield Path(folder)
