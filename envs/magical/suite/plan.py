"""The plan of a task: what its Demo start holds, and what its variants draw.

Poses are x, y (arena units) and angle (rad). Slots without a block, or without a region, lie
outside of the arena: a block there has the shape `NOTHING`, a region the size 0.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from gril_jax.envs.magical.layout import COLOURS
from gril_jax.envs.planar.shapes import NOTHING, SHAPES
from jaxtyping import Array, Bool, Float, Int

VARIANTS = ("demo", "jitter", "color", "shape", "layout", "countplus", "dynamics", "all")
REGION_CLASSES = tuple(f"{colour} region" for colour in COLOURS)
CLASSES = ("robot", *REGION_CLASSES, *(f"{c} {s}" for c in COLOURS for s in SHAPES))
"""What a detector of these tasks' films tells apart."""
OUTSIDE = 2.0  # arena units: x of whatever is not there

Pose = tuple[float, float, float]


class Region(NamedTuple):
    """A region in the original's order of numbers: the top left corner, height, then width."""

    colour: str
    x: float
    y: float
    h: float
    w: float

    def box(self) -> np.ndarray:
        """Centre x, y; width, height."""
        return np.array([self.x + self.w / 2, self.y - self.h / 2, self.w, self.h], np.float32)


class Block(NamedTuple):
    """A block."""

    name: str  # colour and shape
    pose: Pose
    home: int | None = None  # the region that it is placed in


class Plan(NamedTuple):
    """The start of a task."""

    robot: Pose
    blocks: tuple[Block, ...]
    regions: tuple[Region, ...] = ()
    slots: int | None = None  # most blocks of any variant; None: as many as in Demo
    sides: tuple[float, float] = (0.5, 0.8)  # range of the regions' width and height
    margin: float = 0.0  # kept from the region's edge by blocks that are placed in it

    def kinds(self) -> "Kinds":
        """Those of the Demo start."""
        split = [block.name.split() for block in self.blocks]
        return Kinds(
            shape=np.array([SHAPES.index(shape) for _, shape in split], np.int32),
            colour=np.array([COLOURS.index(colour) for colour, _ in split], np.int32),
            region_colour=np.array([COLOURS.index(r.colour) for r in self.regions], np.int32),
            region_there=np.ones(len(self.regions), bool),
        )


class Kinds(NamedTuple):
    """Colours and shapes of what a start holds."""

    shape: Int[Array | np.ndarray, "B"]  # index into `SHAPES`, or `NOTHING`
    colour: Int[Array | np.ndarray, "B"]  # index into `COLOURS`
    region_colour: Int[Array | np.ndarray, "R"]
    region_there: Bool[Array | np.ndarray, "R"]

    def first(self, blocks: Int[Array, ""]) -> "Kinds":
        """Only so many of the blocks."""
        there = jnp.arange(len(self.shape)) < blocks
        return self._replace(shape=jnp.where(there, self.shape, NOTHING))


class Scene(NamedTuple):
    """All that a score depends on."""

    robot: Float[Array, "2"]
    blocks: Float[Array, "B 2"]
    shape: Int[Array, "B"]
    colour: Int[Array, "B"]
    regions: Float[Array, "R 4"]  # centre x, y; width, height
    region_colour: Int[Array, "R"]
    progress: Any = ()  # what the task remembers of the episode

    @property
    def there(self) -> Bool[Array, "B"]:
        """The slots that hold a block."""
        return self.shape != NOTHING


def outside(slot: int) -> Pose:
    """The pose of a slot that holds nothing."""
    return (OUTSIDE, 0.25 * slot - 1.0, 0.0)
