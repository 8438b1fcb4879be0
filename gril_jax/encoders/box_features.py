"""GraphIRL's node features: a box's corners, and distances to the other objects.

Shapes use N for objects, C for classes and F for features; lengths are in world units. Every
function takes one frame; batch with `jax.vmap`.
"""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from gril_jax.errors import ShapeError
from gril_jax.graphs.scene import safe_norm
from gril_jax.types import Nodes

_FAR = 1e30  # finite: it is only ever hidden again


def box_corners(center: Float[Array, "N 2"], size: Float[Array, "N 2"]) -> Float[Array, "N 4"]:
    """x1, y1, x2, y2: the lower left and the upper right corner.

    >>> box_corners(jnp.zeros((1, 2)), jnp.full((1, 2), 2.0))
    Array([[-1., -1.,  1.,  1.]], dtype=float32)
    """
    return jnp.concatenate([center - size / 2, center + size / 2], axis=-1)


def class_distances(
    center: Float[Array, "N 2"], label: Int[Array, "N"], counted: Bool[Array, "N"], num_classes: int
) -> Float[Array, "N C"]:
    """Distance from each object to the nearest counted object of each class; 0 if there is none.

    GraphIRL appends the distances to all objects in a fixed order, one object of each class,
    that to itself (0) included. Sorted by class they are the same numbers, and do not depend on
    the order of the nodes.
    """
    distance = safe_norm(center[:, None] - center)
    counted = counted | jnp.eye(len(label), dtype=bool)
    of_class = label[:, None] == jnp.arange(num_classes)
    among = counted[:, :, None] & of_class
    nearest = jnp.min(jnp.where(among, distance[..., None], _FAR), axis=1, initial=_FAR)
    return jnp.where(jnp.any(among, axis=1), nearest, 0.0)


def history_features(nodes: Nodes, config: Any, *, robot: bool) -> Float[Array, "N F"]:
    """Corners, and distances if asked for, of the last frames side by side.

    Args:
      nodes: of one frame; for a history above 1 of that many frames, oldest first, on a leading
        axis of every field (as `jax.vmap(scene_graph)` stacks them).
      config: its `history`, `distances`, `num_classes` and `length_unit` are used.
      robot: the robot counts in the distances.

    Returns:
      F = history * (4 + C) features. A frame in which an object is not present gives it zeros.

    Raises:
      ShapeError: the number of frames is not `history`.
    """
    history = config.history
    _check_history(nodes, history)
    frames = [nodes] if history == 1 else [Nodes(*(x[t] for x in nodes)) for t in range(history)]
    columns = []
    for frame in frames:
        seen = [box_corners(frame.center, frame.size)]
        if config.distances:
            counted = frame.present if robot else frame.present & ~frame.is_robot
            seen.append(class_distances(frame.center, frame.label, counted, config.num_classes))
        features = jnp.concatenate(seen, axis=-1) / config.length_unit
        columns.append(jnp.where(frame.present[:, None], features, 0.0))
    return jnp.concatenate(columns, axis=-1)


def blank(count: int, history: int) -> Nodes:
    """Nodes of the right shapes, with which a network is made."""
    boxes, flag = jnp.zeros((count, 2)), jnp.zeros(count, bool)
    nodes = Nodes(boxes, boxes, jnp.zeros(count, jnp.int32), flag, flag, flag)
    return nodes if history == 1 else Nodes(*(jnp.stack([x] * history) for x in nodes))


def last_frame(nodes: Nodes, *, history: int) -> Nodes:
    """The newest of the frames that `history_features` takes.

    Raises:
      ShapeError: the nodes do not hold that many frames.
    """
    _check_history(nodes, history)
    return nodes if history == 1 else Nodes(*(x[-1] for x in nodes))


def _check_history(nodes, history):
    shape = nodes.center.shape
    if len(shape) != (2 if history == 1 else 3) or (history > 1 and shape[0] != history):
        wanted = "(N, 2)" if history == 1 else f"({history}, N, 2)"
        raise ShapeError(
            f"graph.nodes.center has shape {shape} but encoder.history is {history}; "
            f"its shape must be {wanted}."
        )
