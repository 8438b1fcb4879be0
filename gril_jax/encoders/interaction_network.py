"""GraphIRL's interaction network (Kumar et al., CoRL 2022), with plain mean pooling.

One round of pairwise messages and no head, E wide everywhere. With Block(x) = h + W2 h + b2 and
h = relu(W1 x + b1), three blocks with weights of their own make the embedding of node i:

    z_i = affector(self_k(x_i) + sum over j != i of relation([x_i; x_j]))

and the latent is the mean of the z_i. The published variants:

    X-MAGICAL   InteractionConfig(num_classes)                   x is the box; k: robot or object
    robot       InteractionConfig(num_classes, distances=True)   x has distances, too; k: the class
    MLP         `gril_jax.encoders.box_mlp`

In the original's robot variant the goal's self block is fed the puck's features, evidently by
mistake; here each block is fed its own node's. Boxes there are in fractions of the image; here
they are in world units over `length_unit`, which differs by a scale and a shift. Shapes use N for
nodes and H for the width. Every function takes one `SceneGraph`; batch with `jax.vmap`.
"""

import dataclasses

import jax
import jax.numpy as jnp
from flax import linen as nn
from jaxtyping import Array, Float, PRNGKeyArray

from gril_jax.config.encoder import EncoderOptions
from gril_jax.errors import ConfigError, require_at_least
from gril_jax.types import SceneGraph

from .box_mlp import blank, box_features
from .dense_messages import sum_messages
from .message_passing import Form, Params, node_weights, weighted_pool


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class InteractionConfig:
    """Static options: changing one recompiles. A pytree without leaves.

    The robot: with it as published, both `pool_robot` and `robot_messages`; without it in the
    pooling, `robot_messages` alone; without its node, neither.
    """

    num_classes: int
    """Number of object classes of the task."""
    width: int = 32
    """Size of a node embedding, of every hidden layer and of the latent."""
    distances: bool = False
    """True if nodes know their distance to the nearest object of each class, and each class has a
    self block; if not, the robot has one and all objects another."""
    pool_robot: bool = True
    """True if the robot counts in the mean."""
    robot_messages: bool = True
    """True if the robot takes part in the others' relations and distances."""
    length_unit: float = EncoderOptions.length_unit
    """World units per unit of the network's inputs; about half the scene's width."""

    def __post_init__(self):
        require_at_least(self, "encoder", num_classes=1, width=1)
        if not self.length_unit > 0:
            raise ConfigError(f"encoder.length_unit is {self.length_unit}; it must be positive.")

    @property
    def latent(self) -> int:
        """Size of the latent: there is no head."""
        return self.width

    @classmethod
    def of(cls, options: EncoderOptions, num_classes: int) -> "InteractionConfig":
        """From the section `encoder` of a run's configuration."""
        return cls(
            num_classes,
            width=options.width,
            distances=True,
            pool_robot=options.robot,
            robot_messages=options.robot,
            length_unit=options.length_unit,
        )


def init(key: PRNGKeyArray, config: InteractionConfig) -> Params:
    """Initial parameters: a dict of the blocks. The key is consumed.

    >>> params = init(jax.random.key(0), InteractionConfig(num_classes=3, width=8))
    >>> sorted(params)
    ['affector_1', 'affector_2', 'relation', 'self']
    """
    return _Interaction(config).init(key, blank(1))["params"]


def node_embeddings(
    params: Params, graph: SceneGraph, config: InteractionConfig, *, form: Form = "dense"
) -> Float[Array, "N H"]:
    """The affector's output for each node; there is one form of it."""
    del form
    return _Interaction(config).apply({"params": params}, graph.nodes)


def readout(
    params: Params,
    embeddings: Float[Array, "N H"],
    graph: SceneGraph,
    config: InteractionConfig,
    *,
    alpha: Float[Array, ""] | float = 1.0,
) -> Float[Array, "H"]:
    """Plain mean of `node_embeddings`: neither `params` nor `alpha` is used."""
    del params, alpha
    nodes = graph.nodes
    weights = node_weights(
        nodes.active, nodes.is_robot, nodes.present, alpha=1.0, pool_robot=config.pool_robot
    )
    return weighted_pool(embeddings, weights)


class _Interaction(nn.Module):
    config: InteractionConfig

    @nn.compact
    def __call__(self, nodes):
        config = self.config
        x = box_features(nodes, config, robot=config.robot_messages)
        audible = nodes.present
        if not config.robot_messages:
            audible = audible & ~nodes.is_robot
        if config.distances:
            kind = jax.nn.one_hot(nodes.label, config.num_classes)
        else:
            kind = jax.nn.one_hot(nodes.is_robot.astype(jnp.int32), 2)
        own = _SelfBlocks(config.width, name="self")(x, kind)
        related = _Relations(config.width, name="relation")(x, audible)
        hidden = nn.relu(nn.Dense(config.width, name="affector_1")(own + related))
        return hidden + nn.Dense(config.width, name="affector_2")(hidden)


class _SelfBlocks(nn.Module):
    """A separate block for each kind. All run on every node, since weights looked up per node would
    be copied for each graph of a batch."""

    width: int

    @nn.compact
    def __call__(self, x, kind):
        (num_nodes, num_kinds), width = kind.shape, self.width
        hidden = nn.relu(nn.Dense(num_kinds * width, name="1")(x))
        hidden = hidden.reshape(num_nodes, num_kinds, width) * kind[..., None]
        # Only one kind's part of the inputs is not zero: the scale is that of a block on its own.
        scaled = nn.initializers.variance_scaling(num_kinds, "fan_in", "truncated_normal")
        second = nn.Dense(width, use_bias=False, kernel_init=scaled, name="2")
        second = second(hidden.reshape(num_nodes, num_kinds * width))
        bias = self.param("bias_2", nn.initializers.zeros, (num_kinds, width))
        return jnp.sum(hidden, axis=1) + second + kind @ bias


class _Relations(nn.Module):
    """Sum of Block([x_i; x_j]) over the audible j != i. The second layer is linear, so it runs on
    the sum of the hidden layers, once per node, with its bias once for each of the pairs."""

    width: int

    @nn.compact
    def __call__(self, x, audible):
        # Two halves of one layer, with the scale of the whole.
        half = nn.initializers.variance_scaling(0.5, "fan_in", "truncated_normal")
        received = nn.Dense(self.width, kernel_init=half, name="1_receiver")(x)
        sent = nn.Dense(self.width, use_bias=False, kernel_init=half, name="1_sender")(x)
        hidden = sum_messages(sent, received, audible)
        bias = self.param("bias_2", nn.initializers.zeros, (self.width,))
        pairs = jnp.sum(audible).astype(x.dtype) - audible.astype(x.dtype)
        second = nn.Dense(self.width, use_bias=False, name="2")(hidden)
        return hidden + second + pairs[:, None] * bias
