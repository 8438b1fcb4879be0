"""Options of encoder training: static choices in `Static`, traced values in `Hyper`.

Defaults come from the sections of a run's configuration that have the same fields.
"""

import dataclasses
import math
from typing import Literal, NamedTuple

import jax
from jaxtyping import Array, Float

from gril_jax.config.encoder import PoolConfig
from gril_jax.config.reward import LossConfig, PretrainConfig
from gril_jax.config.tables import ALIGNMENTS
from gril_jax.encoders.encoder import GraphConfig, NodeConfig, PixelConfig
from gril_jax.errors import ConfigError, require_at_least

Number = Float[Array, ""] | float


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class PixelStatic:
    """Static choices of training on pictures. A pytree without leaves."""

    encoder: PixelConfig
    """The network."""
    consistency: Literal[*ALIGNMENTS] = LossConfig.consistency
    """Alignment of videos in time; an encoder of pictures learns by cycle-consistency alone."""
    updates: int = 100
    """Gradient updates in one call of `step`."""
    num_videos: int = PretrainConfig.num_videos
    """Videos in a batch; all ordered pairs of them are compared."""
    num_frames: int = PretrainConfig.num_frames
    """Frames sampled from each video of a batch."""
    turn_scenes: bool = False
    """Turn and mirror each video of a batch at random, as one of the square's eight symmetries.

    For scenes seen from above whose origin is the middle of a square arena.
    """

    def __post_init__(self):
        require_at_least(self, "pretrain", updates=1, num_videos=2, num_frames=2)


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Static(PixelStatic):
    """Static choices: another value is another compiled program. A pytree without leaves."""

    encoder: GraphConfig
    """Network to train."""
    decoder: Literal["node", "graph"] = LossConfig.decoder
    """Input of the decoder (Eq. 5): each node's embedding, or the latent."""
    window: int = PoolConfig.window
    """Activity window in frames (Eq. 4)."""
    smoothing: int = PoolConfig.smoothing
    """Frames of the median of centres before that, see `gril_jax.graphs.activity`."""
    noise: float | None = PoolConfig.noise
    """Jitter of centres that is no motion, world units, see `gril_jax.graphs.activity`."""
    random_activity: float = 0.0
    """Probability that an object of a video counts as moved throughout, even if it does not move.

    Else the encoder has never seen a state whose bit no demonstration sets, and a mere touch, which
    sets it, may increase the reward.
    """

    rewind: float = PretrainConfig.rewind
    """Probability that a video of a batch ends with a part played backwards."""
    num_perturbations: int = PretrainConfig.num_perturbations
    """Copies with displaced objects of each copied frame, see `gril_jax.pretraining.contrast`;
    0 makes none."""
    perturbed_frames: int = PretrainConfig.perturbed_frames
    """Frames of each video of a batch that are copied."""
    adversarial_steps: int = PretrainConfig.adversarial_steps
    """Steps of each copy towards where it is overestimated most."""
    goal_model: Literal["places", "inside", "arrangement"] = LossConfig.goal_model
    """Judge of copies: `gril_jax.pretraining.final_places`, the same with `anywhere_inside`, or
    `arrangement`."""
    goals: int = LossConfig.goals
    """Goals of the reward: the mean of the last latents, or so many of them."""
    words: tuple[tuple[int, int], ...] = ()
    """First and last words of the class names, for arrangements: `arrangement.words_of`."""
    trim_quantile: float = LossConfig.trim_quantile
    """Share of the ends of an object that the box of its final places leaves out on each side."""
    clearance_radius: float = LossConfig.clearance_radius
    """Distance in halves of its box at which what does not belong there costs nothing."""

    def __post_init__(self):
        super().__post_init__()
        require_at_least(
            self, "pretrain",
            num_perturbations=0, perturbed_frames=1, adversarial_steps=0, window=1, goals=1,
        )  # fmt: skip
        if self.decoder == "node" and not isinstance(self.encoder, NodeConfig):
            raise ConfigError(
                f"pretrain.decoder is 'node', but a {type(self.encoder).__name__} encoder has no "
                f"nodes to decode; it must be 'graph'."
            )


class Hyper(NamedTuple):
    """Traced values: a sweep over them is a vmap and compiles once."""

    learning_rate: Number = PretrainConfig.learning_rate
    lambda_: Number = LossConfig.lambda_  # weight of the reconstruction (Eq. 6)
    temperature: Number = LossConfig.temperature  # of the cycle's soft nearest neighbours
    alpha: Number = PoolConfig.alpha  # weight of an active node in the pooling (Eq. 3)
    tau: Number = PoolConfig.tau  # activity threshold in box diagonals (Eq. 4)
    soft_dtw_weight: Number = LossConfig.soft_dtw_weight  # beside or in place of the cycle
    gamma: Number = LossConfig.gamma  # of soft-DTW, squared latent distance
    # Of perturbed frames: their weight, the fraction of an object's cost that applies at once, the
    # cost of what is where it must not be, the fraction of costs that is for moving at all, the
    # weight of the fourth power of errors, the latent distance from first to last frames.
    perturbation_weight: Number = LossConfig.perturbation_weight
    near_cost_fraction: Number = LossConfig.near_cost_fraction
    intrusion_weight: Number = LossConfig.intrusion_weight
    touch: Number = LossConfig.touch
    quartic_weight: Number = LossConfig.quartic_weight
    latent_scale: Number = LossConfig.latent_scale
    # Updates over which the learning rate falls linearly, and the fraction of it that is left.
    decay_updates: Number = math.inf
    final_learning_rate_fraction: Number = PretrainConfig.final_learning_rate_fraction
    warmup: Number = float(LossConfig.warmup)  # updates over which the time agreement fades out
