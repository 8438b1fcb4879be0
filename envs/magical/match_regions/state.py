"""What MatchRegions remembers of an episode, and quantities derived from a scene."""

from typing import NamedTuple

import jax.numpy as jnp
from gril_jax.envs.base import Objects
from gril_jax.envs.magical import boxes, regions
from gril_jax.envs.magical.suite.plan import Scene
from gril_jax.envs.magical.suite.state import SuiteData
from gril_jax.envs.planar import shapes
from gril_jax.envs.planar.robots import Robot
from jaxtyping import Array, Bool, Float

from .score import ScoreInputs


class Progress(NamedTuple):
    """The memory of an episode beside the simulator's; K targets, B blocks."""

    start_distance: Float[Array, "K"]  # of each target to the region's centre at reset
    nearest: Float[Array, "K"]  # of each target to the robot since reset
    varied: Float[Array, ""]  # 1 in an episode that began with a varied start
    moved: Bool[Array, "B"]  # the blocks that such a start put elsewhere


def distances(points: Float[Array, "K C"], center: Float[Array, "2"]) -> Float[Array, "K"]:
    """Distances of points (x, y, ...) from a centre, arena units."""
    return jnp.sqrt(jnp.sum((points[:, :2] - center) ** 2, axis=1) + 1e-12)


def inputs(scene: Scene, targets: int) -> ScoreInputs:
    """The quantities of scores and rewards; the first blocks are the `targets`."""
    return ScoreInputs(
        inside=regions.holds(scene.regions[0], scene.blocks),
        distance=distances(scene.blocks[:targets], scene.regions[0, :2]),
        start=scene.progress.start_distance,
        reach=distances(scene.blocks[:targets], scene.robot),
        nearest=scene.progress.nearest,
    )


def objects(data: SuiteData, robot: Robot) -> Objects:
    """Region, robot and blocks as a detector would report them."""
    base, blocks, region = data.pose[0], data.pose[len(robot.parts) :], data.regions[0]
    kinds = 2 + len(shapes.SHAPES) * data.colour + data.shape
    sizes = boxes.robot_size(robot, base[2]), boxes.block_sizes(data.shape, blocks[:, 2])
    return Objects(
        center=jnp.concatenate([region[None, :2], base[None, :2], blocks[:, :2]]),
        size=jnp.concatenate([region[None, 2:], sizes[0][None], sizes[1]]),
        label=jnp.concatenate([jnp.arange(2), kinds]).astype(jnp.int32),
        is_robot=jnp.arange(2 + len(blocks)) == 1,
    )
