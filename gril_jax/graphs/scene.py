"""Object boxes of one frame -> fully connected scene graph.

Shapes use N for objects and E = N (N - 1) for ordered pairs. Positions and sizes are in world
units. Every function takes one frame; batch with `jax.vmap`.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from gril_jax.types import Nodes, SceneGraph


def edge_indices(num_nodes: int) -> tuple[Int[Array, "E"], Int[Array, "E"]]:
    """Senders and receivers of the complete directed graph without self edges.

    The order is receiver-major: the first N - 1 edges end at node 0, so that messages of shape
    (E, D) reshape to (N, N - 1, D), receiver first. The indices are constants: a compiler that
    sees them need not guess what is gathered from where.

    >>> [x.tolist() for x in edge_indices(3)]
    [[1, 2, 0, 2, 0, 1], [0, 0, 1, 1, 2, 2]]
    """
    pairs = [(s, r) for r in range(num_nodes) for s in range(num_nodes) if s != r]
    senders = jnp.array([s for s, _ in pairs], jnp.int32)
    receivers = jnp.array([r for _, r in pairs], jnp.int32)
    return senders, receivers


def safe_norm(x: Float[Array, "*batch D"]) -> Float[Array, "*batch"]:
    """Euclidean length over the last axis, with gradient zero (not NaN) at the zero vector.

    The square root never sees the zero: hiding its result alone would still let
    0 * inf = NaN through the backward pass. The length of a vector with NaN in it is NaN.
    """
    squared = jnp.sum(jnp.square(x), axis=-1)
    positive = ~(squared <= 0)
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, squared, 1.0)), 0.0)


def scene_graph(
    center: Float[Array, "N 2"],
    size: Float[Array, "N 2"],
    label: Int[Array, "N"],
    is_robot: Bool[Array, "N"],
    active: Bool[Array, "N"],
    present: Bool[Array, "N"] | None = None,
) -> SceneGraph:
    """The graph of one frame: a node for each object, an edge for each ordered pair.

    Args:
      center, size: box centres, and widths and heights, world units.
      label, is_robot: index of each object's class; nodes that belong to the robot.
      active: nodes that have moved since the episode began (`gril_jax.graphs.activity`).
      present: False for padding; left out, whatever has a box of some size is present. Padding
        keeps its node and edges, so that shapes are static, and is masked where it would count.

    Returns:
      A `jraph.GraphsTuple` with `Nodes` as nodes and (E, 3) edges: the offset from the receiver
      to the sender (x, y) and its length.
    """
    num_nodes = center.shape[0]
    senders, receivers = edge_indices(num_nodes)
    offset = center[senders] - center[receivers]
    if present is None:
        present = jnp.any(size > 0, axis=-1)
    return SceneGraph(
        nodes=Nodes(center, size, label, active, is_robot, present),
        edges=jnp.concatenate([offset, safe_norm(offset)[:, None]], axis=-1),
        senders=senders, receivers=receivers, globals=None,
        n_node=jnp.array([num_nodes], jnp.int32),
        n_edge=jnp.array([senders.shape[0]], jnp.int32),
    )  # fmt: skip
