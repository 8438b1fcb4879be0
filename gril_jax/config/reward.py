"""The sections `loss` and `pretrain`: how the encoder of a learned reward is trained.

The training's own types take their defaults from here.
"""

from dataclasses import dataclass, field
from typing import Annotated, Literal

import tyro

from .tables import ALIGNMENTS, above, at_least, between


@dataclass(frozen=True)
class LossConfig:
    """The loss that trains the encoder."""

    lambda_: Annotated[float, tyro.conf.arg(name="lambda", aliases=("--lambda",))] = field(
        default=1.0, metadata=at_least(0)
    )
    """Weight of reconstruction beside temporal cycle-consistency (Eq. 6)."""
    consistency: Literal[*ALIGNMENTS] = "tcc"
    """Temporal alignment of videos: a form of cycle-consistency (tcc), soft-DTW, or the sum of
    both. Or a method whose reward is the progress that it predicts."""
    temperature: float = field(default=1.0, metadata=above(0))
    """Temperature of the soft nearest neighbours in cycle-consistency."""
    decoder: Literal["node", "graph"] = "node"
    """Input of the reconstruction decoder: each node's embedding (node), or the latent (graph)."""
    perturbation_weight: float = field(default=10.0, metadata=at_least(0))
    """Weight of the loss on perturbed frames, in which objects are displaced."""
    goal_model: Literal["places", "inside", "arrangement"] = "places"
    """Goal of perturbed frames: each class where the last frames show it (places),
    anywhere inside another box (inside), or what all last frames have in common (arrangement)."""
    goals: int = field(default=1, metadata=between(1, 1000))
    """Goals of the reward: 1 is the mean latent of the last frames; more are the latents of as many
    last frames, of which the nearest counts."""
    near_cost_fraction: float = field(default=0.5, metadata=between(0, 1))
    """Fraction of an object's cost that applies once half of its box is out of place, or once its
    centre is out of the box that it belongs in (inside, arrangement)."""
    intrusion_weight: float = field(default=0.5, metadata=at_least(0))
    """Cost of an intruding object beside that of an object out of place."""
    clearance_radius: float = field(default=0.0, metadata=at_least(0))
    """Distance, in halves of its box, at which an intruder costs nothing. 0: it costs in full only
    inside."""
    trim_quantile: float = field(default=0.1, metadata=between(0, 0.4))
    """Fraction of an object's final places that is trimmed on each side."""
    touch: float = field(default=0.0, metadata=between(0, 1))
    """Fraction of an object's cost that vanishes once the object has moved."""
    warmup: int = field(default=1500, metadata=at_least(0))
    """Gradient steps over which a term that aligns times directly fades out. 0 leaves it out."""

    soft_dtw_weight = 1.0
    quartic_weight = 1.0  # of the fourth power of perturbed frames' errors, beside their squares
    gamma = 0.1  # softness of soft-DTW
    latent_scale = 10.0  # latent distance from first to last frames, if perturbed


@dataclass(frozen=True)
class PretrainConfig:
    """Encoder training."""

    steps: int = field(default=2000, metadata=at_least(1))
    """Gradient steps."""
    num_videos: int = field(default=8, metadata=at_least(2))
    """Videos in a batch. Each is aligned with every other one."""
    turn_scenes: bool = True
    """True if each video of a batch is rotated and mirrored at random."""
    final_learning_rate_fraction: float = field(default=1.0, metadata=between(0, 1))
    """Fraction of the learning rate at the end; it falls linearly."""
    num_perturbations: int = field(default=0, metadata=between(0, 1000))
    """Copies with displaced objects of each perturbed frame. 0 makes none."""
    adversarial_steps: int = field(default=0, metadata=between(0, 100))
    """Gradient steps of each copy towards states that the reward overestimates."""
    random_activity: float = field(default=0.1, metadata=between(0, 1))
    """Probability that an object of a video counts as moved throughout, so that touching it has no
    reward."""
    rewind: float = field(default=0.0, metadata=between(0, 1))
    """Probability that a video of a batch ends with a part played backwards, as in ReWiND. What has
    moved by then still counts as moved."""

    learning_rate = 1e-3  # of Adam
    num_frames = 32  # sampled from each video of a batch
    perturbed_frames = 8  # of each video of a batch
