"""Reconstruction of boxes and classes from the node embeddings (Eq. 5 of the paper).

It keeps the encoder from forgetting what and where the objects are while it learns time. The
decoder sees one node's embedding at a time, as in the paper's diagram. Shapes use N for nodes,
H for the embedding's width and C for classes; batch with `jax.vmap`.
"""

import jax
import jax.numpy as jnp
from flax import linen as nn
from jaxtyping import Array, Float, PRNGKeyArray

from ..encoder import EncoderConfig, Params
from ..types import Nodes

__all__ = ["decode", "init", "reconstruction"]


def init(key: PRNGKeyArray, config: EncoderConfig) -> Params:
    """Fresh decoder parameters for an encoder of this config. The key is consumed."""
    return _Decoder(config).init(key, jnp.zeros((1, config.width)))["params"]


def decode(
    params: Params, embeddings: Float[Array, "N H"], config: EncoderConfig
) -> tuple[Float[Array, "N 4"], Float[Array, "N C"]]:
    """Predicted boxes (centre, width and height, in world units) and class logits."""
    out = _Decoder(config).apply({"params": params}, embeddings)
    return out[:, :4] * config.length_unit, out[:, 4:]


def reconstruction(
    box: Float[Array, "N 4"],
    logits: Float[Array, "N C"],
    nodes: Nodes,
    *,
    length_unit: float = 1.0,
) -> Float[Array, "N"]:
    """Box error plus class error of each node; 0 for nodes that are not present.

    Args:
      box: predicted centre, width and height, world units.
      logits: predicted class scores.
      nodes: what the frame really holds.
      length_unit: world units in which box errors count as 1 (`EncoderConfig.length_unit`).

    Returns:
      Mean squared error over the box's four numbers plus cross-entropy of the class in nats.
    """
    truth = jnp.concatenate([nodes.center, nodes.size], axis=-1)
    box_error = jnp.mean(jnp.square((box - truth) / length_unit), axis=-1)
    log_likelihood = jax.nn.log_softmax(logits, axis=-1)
    class_error = -jnp.take_along_axis(log_likelihood, nodes.label[:, None], axis=-1)[:, 0]
    return jnp.where(nodes.present, box_error + class_error, 0.0)


class _Decoder(nn.Module):
    config: EncoderConfig

    @nn.compact
    def __call__(self, embeddings):
        hidden = nn.relu(nn.Dense(self.config.width)(embeddings))
        return nn.Dense(4 + self.config.num_classes)(hidden)
