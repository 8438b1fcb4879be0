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
    """The network: the paper's message passing with weighted pooling, GraphIRL's interaction
    network, GraphIRL's MLP, or XIRL's ResNet-18 on frames (pixels). Pixels use no option of
    boxes."""
    width: int = field(default=64, metadata=at_least(2))
    """Width of the hidden layers and of a node's embedding."""
    rounds: int = field(default=2, metadata=between(0, 16))
    """Rounds of message passing (paper)."""
    latent: int = field(default=32, metadata=at_least(1))
    """Width of the latent (paper, pixels)."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Precision of convolutions (pixels). Parameters and latents are float32 in both."""
    relations: bool = False
    """True if edges also say how far two boxes overlap or are apart, and whether a centre is inside
    the other one."""
    share_attributes: bool = False
    """True if edges say which words two class names share, such as a colour, and nodes do not know
    their class (paper). A reward of red blocks then also holds for blue ones."""
    pair_statistics: bool = False
    """True if the latent is also made of statistics of the distances between pairs of objects, of
    which a cluster or a line consists (paper)."""
    robot: bool = False
    """True if the robot's node exchanges messages and counts in the latent."""
    length_unit: float = field(default=1.0, metadata=above(0))
    """World units per unit of the network's inputs, about half the scene's width. A set of your own
    videos gives it where there is no task."""
    ensemble_size: int = field(default=1, metadata=between(1, 100))
    """Networks that are trained separately. The reward is that of the most pessimistic one."""

    pixels = 64  # width and height of the frames that a pixel encoder sees


@dataclass(frozen=True)
class PoolConfig:
    """Weighted pooling: objects that have moved count more."""

    alpha: float = field(default=5.0, metadata=above(0))
    """Weight of an object that has moved. One that has not weighs 1 (Eq. 3)."""
    window: int = field(default=40, metadata=at_least(1))
    """Frames over which displacement is measured (Eq. 4). A set of your own videos takes four
    seconds where there is no task."""
    noise: float | None = field(default=None, metadata=optional(at_least(0)))
    """Standard deviation of a detected position along one axis, world units. Displacements that it
    explains do not count. None is for exact positions. A set of your own videos gives it."""

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
