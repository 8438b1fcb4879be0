"""The state of a scene, and what policies, detectors and pictures show of it.

Objects come as robot, regions, blocks; the last two in the order of the class names, those of one
class by their x at the Demo start, as videos are read. Slots that hold nothing have boxes of size 0
outside of the arena, and zeros in the observation. Lengths are in arena units.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.base import Objects, Outline
from gril_jax.envs.magical import raster
from gril_jax.envs.magical import scene as looks
from gril_jax.envs.magical.layout import COLOURS, turned
from gril_jax.envs.planar import shapes
from gril_jax.envs.planar.joints import TURN_RATE
from gril_jax.envs.planar.robots import FINGER_OPEN, Robot
from gril_jax.envs.planar.shapes import NOTHING, SHAPES
from jaxtyping import Array, Bool, Float, Int, UInt8

from .plan import Kinds, Plan, Scene


class SuiteData(NamedTuple):
    """The simulator's memory; E bodies are the robot's parts, then B blocks."""

    pose: Float[Array, "E 3"]  # x, y (arena units), angle (rad); a finger's place is its pivot
    velocity: Float[Array, "E 3"]  # per second
    memory: Float[Array, "I"]  # what the engine's solver begins with
    shape: Int[Array, "B"]  # of each block, an index into `planar.shapes.SHAPES`, or `NOTHING`
    colour: Int[Array, "B"]  # an index into `layout.COLOURS`
    regions: Float[Array, "R 4"]  # centre x, y; width, height
    region_colour: Int[Array, "R"]
    strengths: Float[Array, "5"]  # the fields of `joints.Strengths`
    unplaced: Bool[Array, ""]  # the layout found no free place for something
    progress: Any = ()  # what the task itself remembers of the episode


class Order(NamedTuple):
    """The slots in the order of the objects."""

    regions: np.ndarray  # (R,)
    blocks: np.ndarray  # (B,)

    def block(self, slot: int) -> int:
        """The index of a block among the objects."""
        return 1 + len(self.regions) + int(np.flatnonzero(self.blocks == slot)[0])

    def region(self, slot: int) -> int:
        """The index of a region among the objects."""
        return 1 + int(np.flatnonzero(self.regions == slot)[0])


def order(plan: Plan, kinds: Kinds) -> Order:
    """The order of the Demo start's objects; slots that it leaves empty come last."""
    known = len(plan.blocks)
    kind = len(SHAPES) * kinds.colour + kinds.shape
    rows = np.lexsort(([block.pose[0] for block in plan.blocks], kind[:known]))
    places = [region.box()[0] for region in plan.regions]
    regions = np.lexsort((places, kinds.region_colour)) if places else np.zeros(0, int)
    return Order(regions, np.concatenate([rows, np.arange(known, len(kind))]).astype(int))


def scene(data: SuiteData, parts: int) -> Scene:
    """The quantities that a score depends on; the first `parts` bodies are the robot's."""
    return Scene(
        data.pose[0, :2], data.pose[parts : parts + len(data.shape), :2], data.shape, data.colour,
        data.regions, data.region_colour, data.progress,
    )  # fmt: skip


def objects(data: SuiteData, robot: Robot, listed: Order) -> Objects:
    """Robot, regions and blocks as a detector would report them."""
    parts = len(robot.parts)
    base, blocks = data.pose[0], data.pose[parts : parts + len(data.shape)]
    regions, rows = data.regions[listed.regions], listed.blocks
    sizes = block_sizes(data.shape, blocks[:, 2])
    kind = 1 + len(COLOURS) + len(SHAPES) * data.colour + jnp.minimum(data.shape, len(SHAPES) - 1)
    label = [jnp.zeros(1, jnp.int32), 1 + data.region_colour[listed.regions], kind[rows]]
    return Objects(
        center=jnp.concatenate([base[None, :2], regions[:, :2], blocks[rows, :2]]),
        size=jnp.concatenate([
            robot_size(robot, base[2])[None], regions[:, 2:], sizes[rows]
        ]),
        label=jnp.concatenate(label).astype(jnp.int32),
        # Where a robot is all that can move, it is what counts.
        is_robot=(jnp.arange(1 + len(regions) + len(blocks)) == 0) & (len(blocks) > 0),
    )  # fmt: skip


def observe(data: SuiteData, parts: int, listed: Order) -> Float[Array, "O"]:
    """The numbers of `names`, regions and blocks in the order of the objects."""
    x_y, yaw, count = data.pose[0, :2], data.pose[0, 2], len(data.shape)
    blocks, speed = data.pose[parts:][:count], data.velocity[parts:][:count]
    regions = jnp.concatenate([
        turned(-yaw, data.regions[:, :2] - x_y), data.regions,
        jax.nn.one_hot(data.region_colour, len(COLOURS)),
    ], axis=1)  # fmt: skip
    regions = jnp.where(data.regions[:, 2:3] > 0, regions, 0.0)[listed.regions]
    turns = jnp.stack([jnp.cos(blocks[:, 2]), jnp.sin(blocks[:, 2]), speed[:, 2] / 10.0], axis=1)
    each = jnp.concatenate([
        turned(-yaw, blocks[:, :2] - x_y), blocks[:, :2], speed[:, :2], turns,
        jax.nn.one_hot(data.colour, len(COLOURS)), jax.nn.one_hot(data.shape, len(SHAPES)),
    ], axis=1)  # fmt: skip
    each = jnp.where(data.shape[:, None] != NOTHING, each, 0.0)[listed.blocks]
    robot = robot_features(data.pose, data.velocity, parts)
    return jnp.concatenate([*robot, regions.reshape(-1), each.reshape(-1)])


def rows(regions: int, blocks: int) -> tuple[tuple[int, int], ...]:
    """Numbers of regions and of blocks that the observation lists at its end, each with how many
    numbers one of them has."""
    every = [name.partition(":")[0] for name in names(1, 1, fingers=False)]
    return (regions, every.count("region 1")), (blocks, every.count("block 1"))


def names(regions: int, blocks: int, *, fingers: bool) -> tuple[str, ...]:
    """One name for each number of the observation; equal names in a row are one quantity."""
    kinds = {colour: 1 for colour in COLOURS}
    region = {"centre in the robot's frame": 2, "centre": 2, "size": 2} | kinds
    block = {
        "centre in the robot's frame": 2, "centre": 2, "velocity": 2, "angle, cosine and sine": 2,
        "turn rate / 10": 1,
    } | kinds | {shape: 1 for shape in SHAPES}  # fmt: skip
    found = [*robot_names(fingers).items()]
    for what, count, each in (("region", regions, region), ("block", blocks, block)):
        found += [(f"{what} {k + 1}: {p}", n) for k in range(count) for p, n in each.items()]
    return tuple(name for name, count in found for _ in range(count))


def robot_size(robot: Robot, angle: Float[Array, ""]) -> Float[Array, "2"]:
    """Size of the base's box: a disc's fingers are thin, and a detector leaves them out."""
    part = robot.parts[0]
    if part.radius:
        return jnp.full(2, 2 * part.radius)
    c, s = jnp.abs(jnp.cos(angle)), jnp.abs(jnp.sin(angle))
    half = part.boxes[0].half
    return 2 * jnp.stack([c * half[0] + s * half[1], s * half[0] + c * half[1]])


def block_sizes(shape: Int[Array, "B"], angle: Float[Array, "B"]) -> Float[Array, "B 2"]:
    """Sizes of the turned blocks' boxes; 0 for a slot without a block."""
    low, high = shapes.extents(shapes.blocks(shape), angle)
    return high - low


def robot_features(
    pose: Float[Array, "E 3"], velocity: Float[Array, "E 3"], parts: int
) -> list[Float[Array, "_"]]:
    """The numbers of `robot_names`, in parts; the first `parts` bodies are the robot's."""
    yaw = pose[0, 2]
    heading = jnp.stack([jnp.cos(yaw), jnp.sin(yaw)])
    speed = turned(-yaw, velocity[0, :2])[::-1]
    seen = [pose[0, :2], heading, speed, velocity[0, 2:] / TURN_RATE]
    if parts > 1:
        seen.append((pose[1:2, 2] - pose[2:3, 2]) / (2 * FINGER_OPEN))
    return seen


def robot_names(fingers: bool) -> dict[str, int]:
    """Each quantity, and how many numbers it has."""
    return {
        "robot position": 2, "robot heading, cosine and sine": 2,
        "robot speed, forward and sideways": 2, "robot turn rate / 2.5": 1,
        "finger opening": int(fingers),
    }  # fmt: skip


def outlines(
    data: SuiteData, robot: Robot, *, arena: float, look: looks.Look, robot_first: bool
) -> list[Outline]:
    """The outlines of one state, to be painted (host side)."""
    data, parts = jax.tree.map(np.asarray, data), len(robot.parts)
    blocks = np.flatnonzero(data.shape != NOTHING)
    named = [(COLOURS[data.colour[b]], SHAPES[data.shape[b]]) for b in blocks]
    pose = data.pose[np.concatenate([np.arange(parts), parts + blocks])].astype(np.float64)
    regions = [
        (COLOURS[colour], box.astype(np.float64))
        for colour, box in zip(data.region_colour, data.regions, strict=True)
        if box[2] > 0
    ]
    return looks.outlines(robot, named, arena, pose, regions, look=look, robot_first=robot_first)


def render(data: SuiteData, robot: Robot, *, arena: float, **options: Any) -> UInt8[Array, "S S 3"]:
    """The same as an image, inside jit; see `raster.render` for its options."""
    bodies = data.pose[: len(robot.parts) + len(data.shape)]
    drawn = raster.Painting(bodies, data.shape, data.colour, data.regions, data.region_colour)
    return raster.render(drawn, robot=robot.name, arena=arena, **options)
