"""The sections `encoder` and `pool`: the network that a learned reward is made of.

The networks' own configurations take their defaults from here.
"""

from dataclasses import dataclass, field
from typing import Literal

from .rules import above, at_least, between, optional, rule
from .tables import ENCODERS


@dataclass(frozen=True)
class EncoderOptions:
    """The encoder."""

    kind: Literal[*ENCODERS] = "paper"
    """The paper's message passing with weighted pooling, GraphIRL's interaction network or MLP with
    plain mean pooling, or XIRL's ResNet-18 on the frames themselves. Rounds and members belong to
    the first alone, latent to the first and the last. Pixels know no boxes: they learn by temporal
    cycle-consistency alone, and of width, relations, pool_robot, robot_messages, the section pool,
    reconstruction, copies, ascents and touched they use nothing."""
    width: int = field(default=64, metadata=at_least(2))
    """Width of the hidden layers and of a node's embedding; also of the latent of GraphIRL's."""
    rounds: int = field(default=2, metadata=between(0, 16))
    """Rounds of message passing."""
    latent: int = field(default=32, metadata=at_least(1))
    """Width of the latent."""
    pixels: int = field(default=64, metadata=between(16, 1024))
    """Width and height of the frames that a pixel encoder sees."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Precision of convolutions on pixels: bfloat16 is meant for GPUs. Parameters, statistics and
    latents are float32 in both."""
    relations: bool = False
    """True if edges also say how far a box sticks out of the other, and is apart from it."""
    alike: bool = False
    """The paper's alone: True if nodes do not know their class, and edges know instead whether the
    names of two classes share their first word, such as a colour, and their last one, such as a
    shape; so a reward learned from red things holds for blue ones, too. It needs a task."""
    distances: bool = True
    """Interaction alone: each class has weights of its own, and nodes know how far the nearest
    object of each class is, as in GraphIRL's robot tasks; if False, nodes are boxes, as in its
    X-MAGICAL tasks, whose objects are all of one class."""
    pool_robot: bool = False
    """True if the robot's node counts in the pooled latent."""
    robot_messages: bool = False
    """True if the robot's node sends and receives messages."""
    length_unit: float = field(default=1.0, metadata=above(0))
    """World units per unit of the networks' inputs, about half the scene's width."""
    members: int = field(default=1, metadata=between(1, 100))
    """Networks, each trained separately; the reward is that of the most pessimistic one."""


@dataclass(frozen=True)
class PoolConfig:
    """Weighted pooling: objects that have moved count more."""

    alpha: float = field(default=5.0, metadata=above(0))
    """Weight of an object that has moved; one that has not weighs 1."""
    tau: float = field(default=0.005, metadata=at_least(0))
    """Displacement within the window that counts as a move, in diagonals of the object's box."""
    window: int = field(default=40, metadata=at_least(1))
    """Frames over which displacement is measured."""
    smoothing: int = field(
        default=1, metadata=rule(lambda x: x >= 1 and x % 2 == 1, "odd and at least 1")
    )
    """Frames of the running median of positions, against single bad detections; 1 for none."""
    noise: float | None = field(default=None, metadata=optional(at_least(0)))
    """Standard deviation of a detected position along one axis, world units; displacements that it
    explains do not count. None for exact positions."""
