"""What encoder training can vary: static choices in `PretrainConfig`, traced values in `Hyper`."""

import dataclasses
from typing import Literal, NamedTuple

import jax
from jaxtyping import Array, Float

from gril_jax.encoders.encoder import GraphConfig, NodeConfig
from gril_jax.errors import ConfigError

__all__ = ["Hyper", "PretrainConfig"]


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class PretrainConfig:
    """Static choices: another value is another compiled program. A pytree without leaves."""

    encoder: GraphConfig
    """The network."""
    consistency: Literal["tcc", "soft_dtw", "both"] = "tcc"
    """What aligns videos in time: cycle-consistency, soft-DTW, or their sum."""
    form: Literal["regression_mse", "regression_mse_var", "regression_huber", "classification"] = (
        "regression_mse"
    )
    """Of cycle-consistency."""
    matching: Literal["deterministic", "stochastic"] = "deterministic"
    """Cycles of every frame through every other video, or as many drawn at random."""
    similarity: Literal["l2", "cosine"] = "l2"
    """Of two latents, in cycle-consistency."""
    decoder: Literal["node", "graph"] = "node"
    """What is decoded for the reconstruction: each node's embedding, or the latent (Eq. 5)."""
    updates: int = 100
    """Gradient updates in one call of `step`."""
    num_videos: int = 8
    """Videos in a batch; all ordered pairs of them are compared."""
    num_frames: int = 32
    """Frames drawn from each video of a batch."""
    window: int = 40
    """Activity window in frames (Eq. 4)."""
    smoothing: int = 1
    """Frames of the median of centres before that, see `gril_jax.graphs.activity`."""
    noise: float | None = None
    """Jitter of centres that is no motion, world units, see `gril_jax.graphs.activity`."""
    turn_scenes: bool = False
    """Turn and mirror each video of a batch at random, as one of the square's eight symmetries.

    For scenes seen from above whose origin is the middle of a square arena.
    """

    touched: float = 0.0
    """Probability that an object of a video counts as moved throughout, whatever it does.

    Else a bit that no demonstration sets is a state that the encoder has never seen, and a policy
    can earn by setting it: by a mere touch.
    """

    copies: int = 0
    """Copies with displaced objects of each copied frame, see `gril_jax.pretraining.contrast`;
    0 makes none."""
    anchors: int = 8
    """Frames of each video of a batch that are copied."""
    ascents: int = 0
    """Steps of each copy towards where it is overrated most."""

    def __post_init__(self):
        least = {
            "copies": 0,
            "anchors": 1,
            "ascents": 0,
            "updates": 1,
            "num_videos": 2,
            "num_frames": 2,
            "window": 1,
        }
        for field, minimum in least.items():
            if getattr(self, field) < minimum:
                raise ConfigError(
                    f"pretrain.{field} is {getattr(self, field)}; it must be at least {minimum}."
                )
        if self.decoder == "node" and not isinstance(self.encoder, NodeConfig):
            raise ConfigError(
                f"pretrain.decoder is 'node', but a {type(self.encoder).__name__} encoder has no "
                f"nodes to decode; it must be 'graph'."
            )


class Hyper(NamedTuple):
    """Traced values: a sweep over them is a vmap and compiles once."""

    learning_rate: Float[Array, ""] | float = 1e-3
    lambda_: Float[Array, ""] | float = 1.0  # weight of the reconstruction (Eq. 6)
    temperature: Float[Array, ""] | float = 1.0  # of the cycle's soft nearest neighbours
    alpha: Float[Array, ""] | float = 5.0  # weight of an active node in the pooling (Eq. 3)
    tau: Float[Array, ""] | float = 0.005  # activity threshold in box diagonals (Eq. 4)
    soft_dtw_weight: Float[Array, ""] | float = 1.0  # beside or in place of cycle-consistency
    gamma: Float[Array, ""] | float = 0.1  # of soft-DTW, squared latent distance
    contrast: Float[Array, ""] | float = 10.0  # weight of copies with displaced objects
    near: Float[Array, ""] | float = 0.5  # share of an object's cost that is due at once
    idle_cost: Float[Array, ""] | float = 0.5  # of what is where it must not be
    touch: Float[Array, ""] | float = 0.0  # share of that which is for moving it at all
    tail: Float[Array, ""] | float = 1.0  # weight of the fourth power of errors of copies
    span: Float[Array, ""] | float = 10.0  # latent distance from first to last frames, with copies
    decay_updates: Float[Array, ""] | float = 1.0  # over which the learning rate falls linearly
    learning_rate_left: Float[Array, ""] | float = 1.0  # share of it at the end
    warmup: Float[Array, ""] | float = 1500.0  # updates over which the time agreement fades out
