"""The paper's graph encoder: message passing, weighted pooling (Eqs. 2 and 3), a small head.

Shapes use N for nodes, E for edges, H for the width of a node embedding and D for the latent.
Every function takes one `SceneGraph`; batch with `jax.vmap`. Callers use
`gril_jax.encoders.encoder`, which takes the configuration of any encoder.
"""

import dataclasses
from typing import Literal

import jax
import jax.numpy as jnp
from flax import linen as nn
from jaxtyping import Array, Bool, Float, PRNGKeyArray, PyTree

from gril_jax.config.encoder import EncoderOptions, PoolConfig
from gril_jax.errors import ConfigError, require_at_least
from gril_jax.graphs.scene import scene_graph
from gril_jax.types import SceneGraph

from . import graph_features
from .dense_messages import square_edges, sum_messages, thin_product

Params = PyTree[Float[Array, "..."]]

# How messages are summed; the numbers are the same. "dense" takes one sender at a time if there are
# few; "square" takes all senders at once.
Form = Literal["dense", "square"]


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class EncoderConfig:
    """Static options: changing one recompiles.

    Registered as a pytree without leaves, so it passes through `jax.jit` and `jax.vmap` as is.
    The robot: with it, both `pool_robot` and `robot_messages`; without it in the pooling,
    `robot_messages` alone; without its node, neither.
    """

    num_classes: int
    """Number of object classes of the task."""
    width: int = EncoderOptions.width
    """Size of a node embedding and of every hidden layer."""
    rounds: int = EncoderOptions.rounds
    """Rounds of message passing; with 0 each object is embedded separately."""
    latent: int = EncoderOptions.latent
    """Size of the latent, of each member."""
    relations: bool = EncoderOptions.relations
    """True if edges also hold how far the receiver's box sticks out of the sender's or is apart,
    and on which side of the sender's edge its centre is."""
    words: tuple[int, ...] = ()
    """First and last word of each class's name, as indices, class by class: nodes then do not know
    their class, and edges know which of the two words sender and receiver share. Empty: nodes know
    their class."""
    pair_statistics: bool = EncoderOptions.pair_statistics
    """True if the head also gets statistics of the distances between pairs of objects
    (`gril_jax.graphs.pair_statistics`): sums of messages do not tell one cluster from two."""
    pool_robot: bool = EncoderOptions.robot
    """True if the robot counts in the pooling (the paper's "with robot" ablation)."""
    robot_messages: bool = EncoderOptions.robot
    """True if the robot sends messages to the objects."""
    length_unit: float = EncoderOptions.length_unit
    """World units per unit of the network's inputs; about half the scene's width."""
    ensemble_size: int = EncoderOptions.ensemble_size
    """Networks in an ensemble (`gril_jax.encoders.ensemble`); the functions here are for one."""

    def __post_init__(self):
        require_at_least(
            self, "encoder", num_classes=1, width=1, rounds=0, latent=1, ensemble_size=1
        )
        if len(self.words) not in (0, 2 * self.num_classes):
            raise ConfigError(
                f"encoder.words has {len(self.words)} entries; it must have none or two for each "
                f"of {self.num_classes} classes."
            )
        if not self.length_unit > 0:
            raise ConfigError(f"encoder.length_unit is {self.length_unit}; it must be positive.")

    @classmethod
    def of(cls, options: EncoderOptions, num_classes: int) -> "EncoderConfig":
        """From the section `encoder` of a run's configuration."""
        names = "width rounds latent relations pair_statistics length_unit ensemble_size".split()
        same = {name: getattr(options, name) for name in names}
        return cls(num_classes, pool_robot=options.robot, robot_messages=options.robot, **same)


def init(key: PRNGKeyArray, config: EncoderConfig) -> Params:
    """Initial parameters: a dict with the parts `messages` and `head`. The key is consumed.

    >>> sorted(init(jax.random.key(0), EncoderConfig(num_classes=3, width=8, latent=4)))
    ['head', 'messages']
    """
    keys = jax.random.split(key)
    flags = jnp.zeros(2, bool)
    graph = scene_graph(jnp.zeros((2, 2)), jnp.zeros((2, 2)), jnp.zeros(2, jnp.int32), flags, flags)
    return {
        "messages": _Messages(config, "dense").init(keys[0], graph)["params"],
        "head": _Head(config).init(keys[1], jnp.zeros(config.width), graph)["params"],
    }


def node_embeddings(
    params: Params, graph: SceneGraph, config: EncoderConfig, *, form: Form = "dense"
) -> Float[Array, "N H"]:
    """Node embeddings after message passing, before pooling.

    Raises:
      ShapeError: the graph is not complete.
    """
    return _Messages(config, form).apply({"params": params["messages"]}, graph)


def readout(
    params: Params,
    embeddings: Float[Array, "N H"],
    graph: SceneGraph,
    config: EncoderConfig,
    *,
    alpha: Float[Array, ""] | float = PoolConfig.alpha,
) -> Float[Array, "D"]:
    """Pools `node_embeddings` (Eqs. 2, 3), then the head."""
    nodes = graph.nodes
    weights = node_weights(
        nodes.active, nodes.is_robot, nodes.present, alpha=alpha, pool_robot=config.pool_robot
    )
    pooled = weighted_pool(embeddings, weights)
    return _Head(config).apply({"params": params["head"]}, pooled, graph)


def node_weights(
    active: Bool[Array, "N"],
    is_robot: Bool[Array, "N"],
    present: Bool[Array, "N"] | None = None,
    *,
    alpha: Float[Array, ""] | float = PoolConfig.alpha,
    pool_robot: bool = False,
) -> Float[Array, "N"]:
    """Weight of each node in the pooled latent (Eq. 3).

    Args:
      active: nodes that have moved since the episode began.
      is_robot: nodes that belong to the robot. They get weight zero.
      present: False for padding, which gets weight zero; all present if left out.
      alpha: weight of an active node; an idle one has weight 1.
      pool_robot: weigh the robot as any other node (the paper's "with robot" ablation).

    Returns:
      Non-negative weights, not normalised.
    """
    weights = jnp.where(active, jnp.asarray(alpha, jnp.float32), 1.0)
    if not pool_robot:
        weights = jnp.where(is_robot, 0.0, weights)
    return weights if present is None else jnp.where(present, weights, 0.0)


def weighted_pool(z: Float[Array, "N D"], weights: Float[Array, "N"]) -> Float[Array, "D"]:
    """Weighted mean of the node embeddings (Eq. 2).

    A graph whose weights are all zero pools to zeros, with zero gradient, instead of NaN:
    padding and robot-only frames must not poison a batch.

    >>> weighted_pool(jnp.array([[1.0], [3.0]]), jnp.array([1.0, 3.0]))
    Array([2.5], dtype=float32)
    """
    total = jnp.sum(weights)
    return (weights @ z) / jnp.where(total > 0, total, 1.0)


class _Messages(nn.Module):
    """Embeds the nodes, then `rounds` residual updates from the summed messages."""

    config: EncoderConfig
    form: Form

    @nn.compact
    def __call__(self, graph):
        config, nodes = self.config, graph.nodes
        audible = nodes.present
        if not config.robot_messages:
            audible = audible & ~nodes.is_robot
        edges = square_edges(graph_features.of_edges(graph, config), nodes.label.shape[0])
        embedding = nn.Dense(config.width)(graph_features.of_nodes(nodes, config))
        for _ in range(config.rounds):
            embedding = self._round(embedding, audible, edges)
        return embedding

    def _round(self, embedding, audible, edges):
        width = self.config.width
        # Made in this order, since their names in the parameters follow it.
        from_sender = nn.Dense(width, use_bias=False)
        from_receiver = nn.Dense(width)
        from_edge = nn.Dense(width, use_bias=False, dot_general=thin_product)
        from_node, update = nn.Dense(width), nn.Dense(width)

        received = sum_messages(
            from_sender(embedding), from_receiver(embedding), audible, edges, from_edge,
            at_once=None if self.form == "dense" else max(len(audible), 1),
        )  # fmt: skip
        hidden = from_node(jnp.concatenate([embedding, received], axis=-1))
        return embedding + update(nn.relu(hidden))


class _Head(nn.Module):
    """Latents from pooled nodes, by two layers; with statistics of pairs by three wider ones."""

    config: EncoderConfig

    @nn.compact
    def __call__(self, pooled, graph):
        width, hidden = self.config.width, pooled
        if self.config.pair_statistics:
            hidden = jnp.concatenate([pooled, graph_features.of_pairs(graph, self.config)])
            hidden = nn.relu(nn.Dense(2 * width)(hidden))
            width = 2 * width
        hidden = nn.relu(nn.Dense(width)(hidden))
        return nn.Dense(self.config.latent)(hidden)
