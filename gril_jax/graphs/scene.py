"""Object boxes of one frame -> fully connected scene graph; boxes in pixels -> in world units.

Shapes use N for objects and E = N (N - 1) for ordered pairs. Positions and sizes are in world
units. Every function takes one frame; batch with `jax.vmap`.
"""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Real

from gril_jax.errors import ConfigError, ShapeError
from gril_jax.types import Nodes, SceneGraph, checked


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


@checked
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
        keeps its node and edges, so that shapes are static, and is masked where it would count. Its
        box becomes 0, whatever it holds.

    Returns:
      A `jraph.GraphsTuple` with `Nodes` as nodes and (E, 3) edges: the offset from the receiver
      to the sender (x, y) and its length.

    Raises:
      ShapeError: the arrays are not of the same objects.
    """
    num_nodes = center.shape[0]
    if center.shape != (num_nodes, 2) or size.shape != center.shape:
        raise ShapeError(
            f"center has shape {center.shape} and size {size.shape}; both must be (objects, 2)"
        )
    flags = {"label": label, "is_robot": is_robot, "active": active, "present": present}
    for name, flag in flags.items():
        if flag is not None and flag.shape != (num_nodes,):
            raise ShapeError(f"{name} has shape {flag.shape}; it must be ({num_nodes},)")
    senders, receivers = edge_indices(num_nodes)
    if present is None:
        present = jnp.any(size > 0, axis=-1)
    # A mask multiplies by 0 later, and 0 times NaN is NaN.
    center, size = (jnp.where(present[:, None], x, 0.0) for x in (center, size))
    offset = center[senders] - center[receivers]
    return SceneGraph(
        nodes=Nodes(center, size, label, active, is_robot, present),
        edges=jnp.concatenate([offset, safe_norm(offset)[:, None]], axis=-1),
        senders=senders, receivers=receivers, globals=None,
        n_node=jnp.array([num_nodes], jnp.int32),
        n_edge=jnp.array([senders.shape[0]], jnp.int32),
    )  # fmt: skip


@checked
def boxes_from_pixels(
    boxes: Real[Any, "*batch 4"],
    width: int | float,
    height: int | float,
    *,
    half_extent: float = 0.5,
) -> tuple[Float[Any, "*batch 2"], Float[Any, "*batch 2"]]:
    """Centres and sizes of detected boxes, in the units of a demonstration set.

    The origin is the middle of the picture, x goes right and y goes up. `gril demos import-videos`
    converts with the same numbers, so a reward that was learned from such a set can be used with a
    detector's boxes. Arrays of NumPy give arrays of NumPy; those of JAX can be traced.

    >>> center, size = boxes_from_pixels(jnp.array([[0.0, 0.0, 320.0, 240.0]]), 640, 480)
    >>> center.tolist(), size.tolist()
    ([[-0.25, 0.1875]], [[0.5, 0.375]])

    Args:
      boxes: x0, y0, x1, y1 in pixels, with (0, 0) at the top left corner and y down.
      width, height: of the picture, pixels.
      half_extent: half the picture's width in world units, as the set's header has it. The default
        measures in widths of the picture.

    Returns:
      Box centres, and widths and heights, float32. A box that holds NaN gives NaN, which the
      learned reward takes for an object that is not seen.

    Raises:
      ShapeError: the last axis has not four numbers.
      ConfigError: `width`, `height` or `half_extent` is not positive.
    """
    for name, value in {"width": width, "height": height, "half_extent": half_extent}.items():
        if not value > 0:
            raise ConfigError(f"{name} is {value}; it must be positive.")
    xp = boxes.__array_namespace__() if hasattr(boxes, "__array_namespace__") else jnp
    boxes = xp.asarray(boxes)
    if boxes.shape[-1:] != (4,):
        raise ShapeError(f"boxes has shape {boxes.shape}; its last axis must be x0, y0, x1, y1.")
    scale = width / (2 * half_extent)
    low, high = boxes[..., :2], boxes[..., 2:]
    center = ((low + high) / 2 - xp.asarray([width / 2, height / 2])) / scale
    center = center * xp.asarray([1.0, -1.0])
    return center.astype(xp.float32), ((high - low) / scale).astype(xp.float32)
