"""Networks from a scene graph or a picture to a latent (Eqs. 1 to 3): one file each, one table."""

from .encoder import (
    KINDS,
    AnyConfig,
    EncoderConfig,
    GraphConfig,
    InteractionConfig,
    MLPConfig,
    NodeConfig,
    Params,
    PixelConfig,
    apply,
    init,
    node_embeddings,
    readout,
    sees_robot,
)
from .ensemble import num_members
from .message_passing import node_weights, weighted_pool

__all__ = [
    "KINDS", "AnyConfig", "EncoderConfig", "GraphConfig", "InteractionConfig", "MLPConfig",
    "NodeConfig", "Params", "PixelConfig", "apply", "init", "node_embeddings", "node_weights",
    "num_members", "readout", "sees_robot", "weighted_pool",
]  # fmt: skip
