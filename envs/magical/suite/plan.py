"""The plan of a task: what its Demo start holds, what its variants draw, and how regions count.

Poses are x, y (arena units) and angle (rad). Slots without a block, or without a region, lie
outside of the arena: a block there has the shape `NOTHING`, a region the size 0. A score counts
centres; a block that is put into a region is put wholly inside.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.magical.layout import COLOURS
from gril_jax.envs.planar.shapes import NOTHING, SHAPES
from gril_jax.envs.stages import Stage, free_place
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

VARIANTS = ("demo", "jitter", "color", "shape", "layout", "countplus", "dynamics", "all")
REGION_CLASSES = tuple(f"{colour} region" for colour in COLOURS)
CLASSES = ("robot", *REGION_CLASSES, *(f"{c} {s}" for c in COLOURS for s in SHAPES))
"""The kinds of objects that a detector of these tasks' videos tells apart."""
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


def colours(key: PRNGKeyArray, count: int) -> Int[Array, "{count}"]:
    """Independent indices into `COLOURS`."""
    return jax.random.randint(key, (count,), 0, len(COLOURS), jnp.int32)


def shapes(key: PRNGKeyArray, count: int) -> Int[Array, "{count}"]:
    """Independent indices into `SHAPES`."""
    return jax.random.randint(key, (count,), 0, len(SHAPES), jnp.int32)


def each_once(
    key: PRNGKeyArray, drawn: Int[Array, "B"], used: Int[Array, ""] | int
) -> Int[Array, "B"]:
    """Values of which the first `used` have each of 0 to 3 at least once, in random order; the
    others of them are those sampled."""
    values = jnp.concatenate([jnp.arange(4, dtype=jnp.int32), drawn[4:]])
    last = jax.random.uniform(key, drawn.shape) + (jnp.arange(len(drawn)) >= used)
    return values[jnp.argsort(last)]


def in_region(region: Float[Array, "*#K 4"], center: Float[Array, "*#K 2"]) -> Bool[Array, "..."]:
    """True if a centre is in the closed rectangle with that centre, width and height; regions and
    centres are broadcast."""
    return (jnp.abs(center - region[..., :2]) <= region[..., 2:] / 2).all(axis=-1)


def in_region_stage(index: int, region: int, name: str, movable: tuple[int, ...]) -> Stage:
    """The stage in which one object's centre is in a region, both given by their index."""

    def done(center, size):
        return (jnp.abs(center[index] - center[region]) <= size[region] / 2).all()

    def within(center, size):
        return center[region] - size[region] / 2, center[region] + size[region] / 2

    def place(key, center, size):
        room = jnp.maximum(size[region] - size[index], 0.0) / 2
        low, high = center[region] - room, center[region] + room
        return free_place(key, index, center, size, low=low, high=high, others=movable)

    return Stage(name, (index,), done, place, within=within)
