"""GraphIRL's ablation of the interaction network (X-MAGICAL): MLPs on boxes, without relations.

A layer for the robot and one for the objects, whose mean is taken; then a layer on both, which ends
in a ReLU. Shapes use D for the latent. Every function takes one `SceneGraph`; batch with
`jax.vmap`.
"""

import dataclasses

import jax
import jax.numpy as jnp
from flax import linen as nn
from jaxtyping import Array, Float, PRNGKeyArray

from gril_jax.config.encoder import EncoderOptions
from gril_jax.errors import ConfigError, require_at_least
from gril_jax.types import SceneGraph

from .box_features import blank, box_corners
from .message_passing import Params, weighted_pool


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
