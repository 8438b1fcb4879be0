"""GraphIRL's node features: a box's corners, and distances to the other objects.

Shapes use N for objects, C for classes and F for features; lengths are in world units. Every
function takes one frame; batch with `jax.vmap`.
"""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

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


def box_features(nodes: Nodes, config: Any, *, robot: bool) -> Float[Array, "N F"]:
    """Corners, and with `config.distances` the distances to the nearest object of each class.

    Args:
      nodes: of one frame.
      config: its `distances`, `num_classes` and `length_unit` are used.
      robot: the robot counts in the distances.

    Returns:
      F = 4 or 4 + C features in length units; zeros for an object that is not present.
    """
    seen = [box_corners(nodes.center, nodes.size)]
    if config.distances:
        counted = nodes.present if robot else nodes.present & ~nodes.is_robot
        seen.append(class_distances(nodes.center, nodes.label, counted, config.num_classes))
    features = jnp.concatenate(seen, axis=-1) / config.length_unit
    return jnp.where(nodes.present[:, None], features, 0.0)


def blank(count: int) -> Nodes:
    """Nodes of the right shapes, with which a network is made."""
    boxes, flag = jnp.zeros((count, 2)), jnp.zeros(count, bool)
    return Nodes(boxes, boxes, jnp.zeros(count, jnp.int32), flag, flag, flag)
