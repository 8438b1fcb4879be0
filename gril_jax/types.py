"""Types shared by the modules: scene graphs and batches of demonstrations.

Shapes use N for objects (nodes), E = N (N - 1) for edges, T for frames and B for demonstrations.
Positions and sizes are in world units, never in pixels, so that videos with different framing mix.
"""

from typing import NamedTuple

import jraph
from jaxtyping import Array, Bool, Float, Int, UInt8


class Nodes(NamedTuple):
    """The objects of one frame: the `nodes` of a `SceneGraph`."""

    center: Float[Array, "N 2"]  # world units
    size: Float[Array, "N 2"]  # width and height of the axis-aligned box, world units
    label: Int[Array, "N"]  # index into the task's class names
    active: Bool[Array, "N"]  # has moved since the episode began (Eq. 4)
    is_robot: Bool[Array, "N"]
    present: Bool[Array, "N"]  # False for padding


# A fully connected `jraph.GraphsTuple` of one frame. `nodes` is a `Nodes`; `edges` is (E, 3):
# offset of the sender from the receiver (x, y) and its length, in world units; edge order is
# receiver-major without self edges; `globals` is None.
SceneGraph = jraph.GraphsTuple


class DemoBatch(NamedTuple):
    """Demonstrations of one object set, padded to a common length with their last frame."""

    center: Float[Array, "B T N 2"]  # world units
    size: Float[Array, "B T N 2"]
    label: Int[Array, "B N"]
    is_robot: Bool[Array, "B N"]
    present: Bool[Array, "B N"]
    length: Int[Array, "B"]  # frames before padding, at least 1


class VideoBatch(NamedTuple):
    """Videos of square frames, padded to a common length with their last frame."""

    frames: UInt8[Array, "B T P P 3"]  # RGB; x to the right, y upwards
    length: Int[Array, "B"]  # frames before padding, at least 1
