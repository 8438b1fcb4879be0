"""The sections `encoder` and `pool`: the network that a learned reward is made of.

The networks' own configurations take their defaults from here.
"""

from dataclasses import dataclass, field
from typing import Any, Literal

from .tables import ENCODERS, above, at_least, between, optional


@dataclass(frozen=True)
class EncoderOptions:
    """The encoder."""

    kind: Literal[*ENCODERS] = "paper"
    """The paper's message passing with weighted pooling, GraphIRL's interaction network or MLP with
    plain mean pooling, or XIRL's ResNet-18 on the frames themselves. Rounds and ensembles belong to
    the first alone, latent to the first and the last. Pixels know no boxes: they learn by temporal
    cycle-consistency alone, and of width, relations, robot, the section pool, reconstruction,
    perturbations and random activity they use nothing."""
    width: int = field(default=64, metadata=at_least(2))
    """Width of the hidden layers and of a node's embedding; also of the latent of GraphIRL's."""
    rounds: int = field(default=2, metadata=between(0, 16))
    """Rounds of message passing."""
    latent: int = field(default=32, metadata=at_least(1))
    """Width of the latent."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Precision of convolutions on pixels: bfloat16 is meant for GPUs. Parameters, statistics and
    latents are float32 in both."""
    relations: bool = False
    """True if edges also say how far a box sticks out of the other, and is apart from it."""
    share_attributes: bool = False
    """The paper's alone: True if nodes do not know their class, and edges know instead whether the
    names of two classes share their first word, such as a colour, and their last one, such as a
    shape; so a reward learned from red things holds for blue ones, too. It needs a task."""
    robot: bool = False
    """True if the robot's node sends and receives messages, and counts in the pooled latent."""
    length_unit: float = field(default=1.0, metadata=above(0))
    """World units per unit of the networks' inputs, about half the scene's width; a set of one's
    own videos gives it."""
    ensemble_size: int = field(default=1, metadata=between(1, 100))
    """Networks, each trained separately; the reward is that of the most pessimistic one."""

    pixels = 64  # width and height of the frames that a pixel encoder sees


@dataclass(frozen=True)
class PoolConfig:
    """Weighted pooling: objects that have moved count more."""

    alpha: float = field(default=5.0, metadata=above(0))
    """Weight of an object that has moved; one that has not weighs 1."""
    window: int = field(default=40, metadata=at_least(1))
    """Frames over which displacement is measured; a set of one's own videos takes as many as four
    seconds have."""
    noise: float | None = field(default=None, metadata=optional(at_least(0)))
    """Standard deviation of a detected position along one axis, world units. Displacements that it
    explains do not count, and positions are medians over three frames. None for exact positions; a
    set of one's own videos gives it."""

    # The paper's rule: displacement that counts as motion, in diagonals of the object's box, and
    # frames of the median of positions (1 is none).
    tau = 0.005
    smoothing = 1

    def rule(self) -> dict[str, Any]:
        """The options of `gril_jax.graphs.activity`: its arguments by name."""
        smoothing = self.smoothing if self.noise is None else 3
        return {
            "tau": self.tau, "window": self.window, "smoothing": smoothing, "noise": self.noise,
        }  # fmt: skip
