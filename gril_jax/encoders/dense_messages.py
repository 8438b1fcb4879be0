"""Messages between all pairs of a small graph, dense: no gather, no scatter.

A message from j to i is a layer of [x_i; x_j; e_ij]. Its weights split into three parts, so that
the two wide products run once per node and not once per edge:

    relu(W [x_i; x_j; e_ij] + b) = relu((W1 x_i + b) + W2 x_j + W3 e_ij)

Shapes use N for nodes, E = N (N - 1) for edges (receiver-major, as `gril_jax.graphs` makes them),
F for edge features and H for the width. Every function takes one graph; batch with `jax.vmap`.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from gril_jax.errors import ShapeError

# Up to this many nodes one sender at a time, unrolled: the (N, N, H) messages never lie in memory,
# which makes the fastest forward pass on CPU. Beyond it the unrolled program would grow long.
_MOST_UNROLLED = 16


def square_edges(edges: Float[Array, "E F"], num_nodes: int) -> Float[Array, "N N F"]:
    """Edge features as a table: receiver, sender; zeros on the diagonal.

    Read row by row, the table without its first entry is N - 1 rows of N + 1 whose last column
    is the rest of the diagonal.

    >>> square_edges(jnp.array([[1.0], [2.0]]), 2)[..., 0]
    Array([[0., 1.],
           [2., 0.]], dtype=float32)

    Raises:
      ShapeError: there are not N (N - 1) edges.
    """
    num_edges, num_features = edges.shape
    if num_edges != num_nodes * (num_nodes - 1):
        raise ShapeError(
            f"edges has shape {edges.shape} but there are {num_nodes} nodes; a complete graph "
            f"without self edges has {num_nodes * (num_nodes - 1)} edges."
        )
    if num_nodes < 2:
        return jnp.zeros((num_nodes, num_nodes, num_features), edges.dtype)
    rows = edges.reshape(num_nodes - 1, num_nodes, num_features)
    rows = jnp.pad(rows, ((0, 0), (0, 1), (0, 0))).reshape(num_nodes**2 - 1, num_features)
    return jnp.pad(rows, ((1, 0), (0, 0))).reshape(num_nodes, num_nodes, num_features)


def sum_messages(
    sent: Float[Array, "N H"],
    received: Float[Array, "N H"],
    audible: Bool[Array, "N"],
    edges: Float[Array, "N N F"] | None = None,
    edge_layer: Callable[[Array], Array] | None = None,
    *,
    at_once: int | None = None,
) -> Float[Array, "N H"]:
    """Sum over j != i of relu(sent_j + received_i + edge_layer(edges_ij)), for each node i.

    Args:
      sent: the layer's part that depends on the sender, W2 x_j.
      received: its part that depends on the receiver, W1 x_i + b.
      audible: nodes whose messages count.
      edges: edge features by receiver and sender, from `square_edges`; with `edge_layer` only.
      edge_layer: the part that depends on the edge, (..., F) -> (..., H).
      at_once: how many senders one step of the unrolled sum takes; changes speed and memory,
        not the result. Chosen by the number of nodes if left out.

    Returns:
      Zeros for a node that no other node talks to.
    """
    num_nodes = sent.shape[0]
    if at_once is None:
        at_once = 1 if num_nodes <= _MOST_UNROLLED else num_nodes
    heard = audible & ~jnp.eye(num_nodes, dtype=bool)
    total = jnp.zeros_like(received)
    for first in range(0, num_nodes, at_once):
        some = slice(first, first + at_once)
        message = sent[some] + received[:, None]
        if edges is not None and edge_layer is not None:
            message = message + edge_layer(edges[:, some])
        message = jnp.where(heard[:, some, None], jax.nn.relu(message), 0.0)
        total = total + jnp.sum(message, axis=1)
    return total


def thin_product(
    x: Float[Array, "*batch F"], kernel: Float[Array, "F H"], *_, **__
) -> Float[Array, "*batch H"]:
    """`x @ kernel` for few features; a `dot_general` for `flax.linen.Dense`.

    Forward it is a sum of elementwise terms, which fuse with what follows, where a matrix product
    would write the wide result to memory. Its derivative is that of the matrix product, since the
    gradient of elementwise terms would pass over the wide array once for each feature.
    """
    return _thin(x, kernel)


@jax.custom_jvp
def _thin(x, kernel):
    return sum(x[..., i, None] * kernel[i] for i in range(kernel.shape[0]))


@_thin.defjvp
def _thin_jvp(primals, tangents):
    (x, kernel), (dx, dkernel) = primals, tangents
    return _thin(x, kernel), x @ dkernel + dx @ kernel
