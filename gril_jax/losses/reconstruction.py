"""Reconstruction of boxes and classes (Eq. 5 of the paper), from the nodes or from the graph.

The paper's diagram decodes each node's embedding by itself (`init`, `decode`); its Eq. 5 decodes
the graph's one vector (`init_graph`, `decode_graph`). Shapes use N for nodes, H for the width of
what is decoded and C for classes; batch with `jax.vmap`.
"""

import jax
import jax.numpy as jnp
from flax import linen as nn
from jaxtyping import Array, Float, PRNGKeyArray

from gril_jax.encoders.encoder import GraphConfig, NodeConfig, Params
from gril_jax.errors import ConfigError, ShapeError
from gril_jax.types import Nodes, checked

from .soft_neighbour import check_positive


def init(key: PRNGKeyArray, config: NodeConfig) -> Params:
    """Initial parameters of the node decoder, for an encoder of this config. Consumes the key."""
    return _Decoder(config).init(key, jnp.zeros((1, config.width)))["params"]


@checked
def decode(
    params: Params, embeddings: Float[Array, "N H"], config: NodeConfig
) -> tuple[Float[Array, "N 4"], Float[Array, "N C"]]:
    """Predicted boxes (centre, width and height, in world units) and class logits."""
    out = _Decoder(config).apply({"params": params}, embeddings)
    return out[:, :4] * config.length_unit, out[:, 4:]


def init_graph(key: PRNGKeyArray, config: GraphConfig, *, num_nodes: int) -> Params:
    """Initial parameters of the graph decoder of the latent. The key is consumed.

    Raises:
      ConfigError: there are no nodes.
    """
    if num_nodes < 1:
        raise ConfigError(f"num_nodes is {num_nodes}; it must be at least 1.")
    return _Decoder(config, num_nodes).init(key, jnp.zeros(config.latent))["params"]


@checked
def decode_graph(
    params: Params, vector: Float[Array, "H"], config: GraphConfig, *, num_nodes: int
) -> tuple[Float[Array, "N 4"], Float[Array, "N C"]]:
    """Every node's predicted box (world units) and class logits, from one vector (Eq. 5).

    Outputs are in the order of the nodes: it is for frames that list the same objects in the
    same order, as `gril_jax.types.DemoBatch` does. Node i's class is then the same in every
    frame, and its logits are easily learned; the boxes are what the vector must carry. A robot
    that has no weight in the pooling cannot be decoded; take it out of `present` in the loss.

    >>> from gril_jax.encoders.encoder import EncoderConfig
    >>> config = EncoderConfig(num_classes=3, latent=8)
    >>> params = init_graph(jax.random.key(0), config, num_nodes=5)
    >>> box, logits = decode_graph(params, jnp.zeros(8), config, num_nodes=5)
    >>> box.shape, logits.shape
    ((5, 4), (5, 3))
    """
    out = _Decoder(config, num_nodes).apply({"params": params}, vector)
    out = out.reshape(num_nodes, 4 + config.num_classes)
    return out[:, :4] * config.length_unit, out[:, 4:]


@checked
def reconstruction(
    box: Float[Array, "N 4"], logits: Float[Array, "N C"], nodes: Nodes, *, length_unit: float = 1.0
) -> Float[Array, "N"]:
    """Box error plus class error of each node; 0 for nodes that are not present.

    Args:
      box: predicted centre, width and height, world units.
      logits: predicted class scores.
      nodes: what the frame really holds.
      length_unit: world units in which box errors count as 1 (`EncoderConfig.length_unit`).

    Returns:
      Mean squared error over the box's four numbers plus cross-entropy of the class in nats.

      Both are 0, with gradient 0, for nodes that are not present, whatever padding holds. A label
      that is none of the C classes has class error 0.

    Raises:
      ShapeError: predictions and nodes do not fit together.
      ConfigError: `length_unit` is not positive.
    """
    check_positive("length_unit", length_unit)
    num_nodes = nodes.label.shape[0]
    if box.shape != (num_nodes, 4) or logits.ndim != 2 or logits.shape[0] != num_nodes:
        raise ShapeError(
            f"box has shape {box.shape} and logits has shape {logits.shape}; for {num_nodes} "
            f"nodes they must be ({num_nodes}, 4) and ({num_nodes}, classes)."
        )
    present = nodes.present[:, None]
    truth = jnp.concatenate([nodes.center, nodes.size], axis=-1)
    # Hidden before the arithmetic: after it, 0 times NaN would come back through the gradient.
    difference = jnp.where(present, box, 0.0) - jnp.where(present, truth, 0.0)
    box_error = jnp.mean(jnp.square(difference / length_unit), axis=-1)
    log_likelihood = jax.nn.log_softmax(jnp.where(present, logits, 0.0), axis=-1)
    label = jnp.where(nodes.present, nodes.label, -1)
    is_label = label[:, None] == jnp.arange(logits.shape[1])
    class_error = -jnp.sum(jnp.where(is_label, log_likelihood, 0.0), axis=-1)
    return box_error + class_error


class _Decoder(nn.Module):
    config: GraphConfig
    num_outputs: int = 1

    @nn.compact
    def __call__(self, embeddings):
        hidden = nn.relu(nn.Dense(self.config.width)(embeddings))
        return nn.Dense(self.num_outputs * (4 + self.config.num_classes))(hidden)
