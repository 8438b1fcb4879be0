"""The sections `loss` and `pretrain`: how the encoder of a learned reward is trained.

The training's own types take their defaults from here.
"""

from dataclasses import dataclass, field
from typing import Annotated, Literal

import tyro

from .rules import above, at_least, between
from .tables import ALIGNMENTS


@dataclass(frozen=True)
class LossConfig:
    """The loss that trains the encoder."""

    lambda_: Annotated[float, tyro.conf.arg(name="lambda", aliases=("--lambda",))] = field(
        default=1.0, metadata=at_least(0)
    )
    """Weight of reconstruction relative to temporal cycle-consistency."""
    consistency: Literal[*ALIGNMENTS] = "tcc"
    """Temporal alignment of videos: temporal cycle-consistency, soft-DTW divergence, or the sum."""
    form: Literal["regression_mse", "regression_mse_var", "regression_huber", "classification"] = (
        "regression_mse"
    )
    """Form of temporal cycle-consistency."""
    matching: Literal["deterministic", "stochastic"] = "deterministic"
    """Cycles of every frame through every other video, or as many sampled at random."""
    similarity: Literal["l2", "cosine"] = "l2"
    """Similarity of two latents in temporal cycle-consistency."""
    temperature: float = field(default=1.0, metadata=above(0))
    """Temperature of the soft nearest neighbours in temporal cycle-consistency."""
    soft_dtw_weight: float = field(default=1.0, metadata=at_least(0))
    """Weight of soft-DTW."""
    gamma: float = field(default=0.1, metadata=above(0))
    """Softness of soft-DTW."""
    decoder: Literal["node", "graph"] = "node"
    """Input of the reconstruction decoder: each node's embedding, or the latent."""
    contrast: float = field(default=10.0, metadata=at_least(0))
    """Weight of frame copies with displaced objects; pretrain.copies sets their number."""
    ends: Literal["places", "arrangement"] = "places"
    """Meaning of done in copies: every class where the last frames leave it, or whatever all
    last frames have in common, such as distances between blocks of a colour."""
    goals: int = field(default=1, metadata=between(1, 1000))
    """Goals of the reward: 1 is the mean of the last frames' latents; more are the latents of as
    many last frames, of which the nearest counts."""
    near: float = field(default=0.5, metadata=between(0, 1))
    """Share of an object's cost that is due once it is out of place by half its box."""
    anywhere_inside: bool = False
    """True if an object that demonstrations bring into another's box belongs anywhere in it, by its
    centre; if False it belongs where demonstrations leave it. They do not show which."""
    idle_cost: float = field(default=0.5, metadata=at_least(0))
    """Cost of an intruding object relative to that of an object out of place."""
    clear: float = field(default=0.0, metadata=at_least(0))
    """Distance in halves of its box, from where demonstrations leave others, at which an intruder
    costs nothing; it costs in full where they do. 0: in full only half its box deep in there."""
    tails: float = field(default=0.1, metadata=between(0, 0.4))
    """Share of the ends of an object that the box of its final places leaves out on each side."""
    touch: float = field(default=0.0, metadata=between(0, 1))
    """Share of the cost of an object to be moved that vanishes once it has been touched."""
    tail: float = field(default=1.0, metadata=at_least(0))
    """Weight of the fourth power of the copies' errors, relative to their squares."""
    span: float = field(default=10.0, metadata=above(0))
    """Latent distance from first to last frames, if there are copies."""
    warmup: int = field(default=1500, metadata=at_least(0))
    """Gradient steps over which a term that aligns times directly fades out; 0 leaves it out."""


@dataclass(frozen=True)
class PretrainConfig:
    """Encoder training."""

    steps: int = field(default=2000, metadata=at_least(1))
    """Gradient steps."""
    learning_rate: float = field(default=1e-3, metadata=above(0))
    """Learning rate of Adam."""
    num_videos: int = field(default=8, metadata=at_least(2))
    """Videos in a batch; each is aligned with every other one."""
    num_frames: int = field(default=32, metadata=at_least(2))
    """Frames sampled from each video of a batch."""
    turn_scenes: bool = True
    """True if each video of a batch is turned and mirrored at random: eightfold variety."""
    learning_rate_left: float = field(default=1.0, metadata=between(0, 1))
    """Share of the learning rate at the end, reached linearly."""
    copies: int = field(default=0, metadata=between(0, 1000))
    """Copies with displaced objects of each frame that is copied; 0 makes none."""
    anchors: int = field(default=8, metadata=between(1, 1000))
    """Frames of each video of a batch that are copied."""
    ascents: int = field(default=0, metadata=between(0, 100))
    """Steps of each copy towards states that the reward overestimates most."""
    touched: float = field(default=0.1, metadata=between(0, 1))
    """Probability that an object of a video counts as moved throughout: no reward for a touch."""
