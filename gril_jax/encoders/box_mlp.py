"""GraphIRL's node features, and its ablation of the interaction network (X-MAGICAL): MLPs on boxes.

Features are a box's corners, and distances to the other objects. The ablation has no relations: a
layer for the robot and one for the objects, whose mean is taken; then a layer on both, which ends
in a ReLU. Shapes use N for objects, C for classes, F for features and D for the latent; lengths are
in world units. Every function takes one frame; batch with `jax.vmap`.
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
from flax import linen as nn
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from gril_jax.config.encoder import EncoderOptions
from gril_jax.errors import ConfigError, require_at_least
from gril_jax.graphs.scene import safe_norm
from gril_jax.types import Nodes, SceneGraph

from .message_passing import Params, weighted_pool

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


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class MLPConfig:
    """Static options: changing one recompiles. A pytree without leaves."""

    num_classes: int
    """Number of object classes of the task."""
    width: int = 32
    """Size of the latent; the hidden layers have half of it. Even."""
    pool_robot: bool = True
    """True if the robot counts; if not, its inputs are zero."""
    length_unit: float = EncoderOptions.length_unit
    """World units per unit of the network's inputs; about half the scene's width."""

    def __post_init__(self):
        require_at_least(self, "encoder", num_classes=1, width=2)
        if self.width % 2:
            raise ConfigError(f"encoder.width is {self.width}; it must be even.")
        if not self.length_unit > 0:
            raise ConfigError(f"encoder.length_unit is {self.length_unit}; it must be positive.")

    @property
    def latent(self) -> int:
        """Size of the latent."""
        return self.width

    @classmethod
    def of(cls, options: EncoderOptions, num_classes: int) -> "MLPConfig":
        """From the section `encoder` of a run's configuration."""
        unit = options.length_unit
        return cls(num_classes, options.width, pool_robot=options.robot, length_unit=unit)


def init(key: PRNGKeyArray, config: MLPConfig) -> Params:
    """Initial parameters: a dict of the layers. The key is consumed.

    >>> sorted(init(jax.random.key(0), MLPConfig(num_classes=3, width=8)))
    ['agent', 'boxes', 'latent']
    """
    return _BoxMLP(config).init(key, blank(1))["params"]


def apply(params: Params, graph: SceneGraph, config: MLPConfig) -> Float[Array, "D"]:
    """The latent of one scene graph."""
    return _BoxMLP(config).apply({"params": params}, graph.nodes)


class _BoxMLP(nn.Module):
    config: MLPConfig

    @nn.compact
    def __call__(self, nodes):
        config, half = self.config, self.config.width // 2
        x = box_corners(nodes.center, nodes.size) / config.length_unit
        x = jnp.where(nodes.present[:, None], x, 0.0)
        robot = nodes.present & nodes.is_robot & config.pool_robot
        objects = nodes.present & ~nodes.is_robot
        agent = nn.relu(nn.Dense(half, name="agent")(x))
        boxes = nn.relu(nn.Dense(half, name="boxes")(x))
        parts = (agent, robot), (boxes, objects)
        pooled = [weighted_pool(z, w.astype(z.dtype)) for z, w in parts]
        return nn.relu(nn.Dense(config.width, name="latent")(jnp.concatenate(pooled)))
