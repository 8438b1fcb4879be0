"""The graph encoder phi: message passing between objects, weighted pooling, a small head.

Shapes use N for nodes, E for edges, H for the width of a node embedding and D for the latent.
Every function takes one `SceneGraph`; batch with `jax.vmap`. Parameters are plain pytrees of
arrays: hold, save and vmap them without knowing either library underneath.
"""

import dataclasses

import jax
import jax.numpy as jnp
import jraph
from flax import linen as nn
from jaxtyping import Array, Float, PRNGKeyArray, PyTree

from .errors import ConfigError
from .graphs import edge_indices, scene_graph
from .pooling import node_weights, weighted_pool
from .types import SceneGraph

__all__ = ["EncoderConfig", "Params", "apply", "init", "node_embeddings", "readout"]

Params = PyTree[Float[Array, "..."]]


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class EncoderConfig:
    """Static choices: another value is another compiled program.

    Registered as a pytree without leaves, so it passes through `jax.jit` and `jax.vmap` as is.
    """

    num_classes: int
    """How many object classes the task has."""
    width: int = 64
    """Size of a node embedding and of every hidden layer."""
    rounds: int = 2
    """Rounds of message passing; with 0 each object is embedded on its own."""
    latent: int = 32
    """Size of the latent."""
    absolute: bool = True
    """Nodes know their absolute centre; if not, position enters by the edges' offsets alone."""
    pool_robot: bool = False
    """The robot counts in the pooling (the paper's "with robot" ablation)."""
    robot_messages: bool = False
    """The robot sends messages to the objects."""
    length_unit: float = 1.0
    """World units that make one unit of the network's inputs; about half the scene's width."""

    def __post_init__(self):
        for field, least in (("num_classes", 1), ("width", 1), ("rounds", 0), ("latent", 1)):
            if getattr(self, field) < least:
                raise ConfigError(
                    f"encoder.{field} is {getattr(self, field)}; it must be at least {least}."
                )
        if not self.length_unit > 0:
            raise ConfigError(f"encoder.length_unit is {self.length_unit}; it must be positive.")


def init(key: PRNGKeyArray, config: EncoderConfig) -> Params:
    """Fresh parameters: a dict with the parts `messages` and `head`. The key is consumed."""
    keys = jax.random.split(key)
    flags = jnp.zeros(2, bool)
    graph = scene_graph(jnp.zeros((2, 2)), jnp.zeros((2, 2)), jnp.zeros(2, jnp.int32), flags, flags)
    return {
        "messages": _Messages(config).init(keys[0], graph)["params"],
        "head": _Head(config).init(keys[1], jnp.zeros(config.width))["params"],
    }


def apply(
    params: Params,
    graph: SceneGraph,
    config: EncoderConfig,
    *,
    alpha: Float[Array, ""] | float = 5.0,
) -> Float[Array, "D"]:
    """The latent of one scene graph.

    It does not depend on the order of the nodes, nor on the nodes that are not present, nor
    (unless `pool_robot` or `robot_messages` is set) on the robot.

    Args:
      params: from `init`, with the same config.
      graph: from `gril_jax.graphs.scene_graph`; its edge order is taken as given there.
      config: static choices.
      alpha: weight of an active node in the pooling (Eq. 3); may be traced.
    """
    return readout(params, node_embeddings(params, graph, config), graph, config, alpha=alpha)


def node_embeddings(
    params: Params, graph: SceneGraph, config: EncoderConfig
) -> Float[Array, "N H"]:
    """What message passing makes of each node, before pooling."""
    return _Messages(config).apply({"params": params["messages"]}, graph)


def readout(
    params: Params,
    embeddings: Float[Array, "N H"],
    graph: SceneGraph,
    config: EncoderConfig,
    *,
    alpha: Float[Array, ""] | float = 5.0,
) -> Float[Array, "D"]:
    """The second half of `apply`: pools `node_embeddings` (Eqs. 2, 3), then the head."""
    nodes = graph.nodes
    weights = node_weights(
        nodes.active, nodes.is_robot, nodes.present, alpha=alpha, pool_robot=config.pool_robot
    )
    pooled = weighted_pool(embeddings, weights)
    return _Head(config).apply({"params": params["head"]}, pooled)


class _Messages(nn.Module):
    """Embeds the nodes, then `rounds` residual updates from the summed messages."""

    config: EncoderConfig

    @nn.compact
    def __call__(self, graph):
        config, nodes = self.config, graph.nodes
        senders, receivers = edge_indices(nodes.label.shape[0])  # constants, also under vmap
        speaks = nodes.present
        if not config.robot_messages:
            speaks = speaks & ~nodes.is_robot
        graph = graph._replace(
            edges=graph.edges / config.length_unit, senders=senders, receivers=receivers
        )
        embedding = nn.Dense(config.width)(_node_features(nodes, config))
        for _ in range(config.rounds):
            embedding = self._round(embedding, speaks[senders, None], graph)
        return embedding

    def _round(self, embedding, audible, graph):
        """One round. An edge's layer sees [receiver, sender, edge]; its weights are applied in
        three parts, so that the wide two run once per node and not once per edge."""
        width = self.config.width
        from_sender = nn.Dense(width, use_bias=False)(embedding)
        from_receiver = nn.Dense(width)(embedding)
        from_edge = nn.Dense(width, use_bias=False, dot_general=_thin_product)(graph.edges)

        def update_edge(edge, *_):
            return jnp.where(audible, nn.relu(edge), 0.0)

        def update_node(node, _, received, __):
            hidden = nn.Dense(width)(jnp.concatenate([node, received], axis=-1))
            return node + nn.Dense(width)(nn.relu(hidden))

        # jraph would gather both ends by index, whose gradient is a scatter: slow on CPU. Ours
        # are already on the edges, by reshapes; its own gathers go unused, and compile away.
        network = jraph.GraphNetwork(
            update_edge, update_node, aggregate_edges_for_nodes_fn=_sum_by_receiver
        )
        edges = from_edge + _spread_senders(from_sender) + _spread_receivers(from_receiver)
        return network(graph._replace(nodes=embedding, edges=edges)).nodes


class _Head(nn.Module):
    config: EncoderConfig

    @nn.compact
    def __call__(self, pooled):
        hidden = nn.relu(nn.Dense(self.config.width)(pooled))
        return nn.Dense(self.config.latent)(hidden)


def _node_features(nodes, config):
    """One-hot class, size and (if `absolute`) centre."""
    boxes = [nodes.center, nodes.size] if config.absolute else [nodes.size]
    boxes = [box / config.length_unit for box in boxes]
    return jnp.concatenate([jax.nn.one_hot(nodes.label, config.num_classes), *boxes], axis=-1)


def _spread_senders(x):
    """(N, H) -> (E, H): each edge's sender. Read row by row, the N x N table of senders without
    its first entry is N - 1 rows of N + 1 whose last column is the rest of the diagonal."""
    num_nodes, width = x.shape
    table = jnp.broadcast_to(x, (num_nodes, num_nodes, width)).reshape(-1, width)
    table = table[1:].reshape(num_nodes - 1, num_nodes + 1, width)
    return table[:, :-1].reshape(num_nodes * (num_nodes - 1), width)


def _spread_receivers(x):
    """(N, H) -> (E, H): each edge's receiver."""
    num_nodes, width = x.shape
    spread = jnp.broadcast_to(x[:, None], (num_nodes, num_nodes - 1, width))
    return spread.reshape(num_nodes * (num_nodes - 1), width)


def _sum_by_receiver(messages, _, num_nodes):
    """Sums messages per receiver: a reshape, as edges are receiver-major. jraph also calls it
    for the senders; our node update ignores that sum, and the compiler drops it."""
    return messages.reshape(num_nodes, num_nodes - 1, messages.shape[-1]).sum(axis=1)


def _thin_product(x, kernel, *_, **__):
    """`x @ kernel` for a handful of input features, as elementwise terms: they fuse with what
    follows, where a matrix product would write the wide (E, H) result to memory."""
    return sum(x[:, i, None] * kernel[i] for i in range(x.shape[-1]))
