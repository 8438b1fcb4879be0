"""The state of a MatchRegions scene, and quantities derived from it."""

from typing import NamedTuple

import jax.numpy as jnp
from gril_jax.envs.base import Objects
from gril_jax.envs.magical import boxes
from gril_jax.envs.planar import shapes
from gril_jax.envs.planar.robots import Robot
from jaxtyping import Array, Bool, Float, Int

from .score import ScoreInputs


class PlanarData(NamedTuple):
    """The simulator's memory; E bodies are the robot's parts, then B blocks."""

    pose: Float[Array, "E 3"]  # x, y (arena units), angle (rad); a finger's place is its pivot
    velocity: Float[Array, "E 3"]  # per second
    memory: Float[Array, "I"]  # what the engine's solver begins with
    shape: Int[Array, "B"]  # of each block, an index into `planar.shapes.SHAPES`
    colour: Int[Array, "B"]  # an index into COLOURS; the region has the first target's
    strengths: Float[Array, "5"]  # the fields of `joints.Strengths`
    goal: Float[Array, "4"]  # centre x, y; width, height
    start_distance: Float[Array, "K"]  # of each target to the region's centre at reset
    nearest: Float[Array, "K"]  # of each target to the robot since reset
    unplaced: Bool[Array, ""]  # the layout found no free place for something
    varied: Float[Array, ""]  # 1 in an episode that began with a varied start
    moved: Bool[Array, "B"]  # the blocks that such a start put elsewhere


def distances(points: Float[Array, "K C"], center: Float[Array, "2"]) -> Float[Array, "K"]:
    """Distances of points (x, y, ...) from a centre, arena units."""
    return jnp.sqrt(jnp.sum((points[:, :2] - center) ** 2, axis=1) + 1e-12)


def progress(data: PlanarData, *, parts: int, targets: int) -> ScoreInputs:
    """The quantities of scores and rewards; `parts` bodies are the robot's, then come targets."""
    blocks = data.pose[parts:]
    return ScoreInputs(
        inside=(jnp.abs(blocks[:, :2] - data.goal[:2]) <= data.goal[2:] / 2).all(axis=1),
        distance=distances(blocks[:targets], data.goal[:2]),
        start=data.start_distance,
        reach=distances(blocks[:targets], data.pose[0, :2]),
        nearest=data.nearest,
    )


def objects(data: PlanarData, robot: Robot) -> Objects:
    """Region, robot and blocks as a detector would report them."""
    base, blocks = data.pose[0], data.pose[len(robot.parts) :]
    kinds = 2 + len(shapes.SHAPES) * data.colour + data.shape
    return Objects(
        center=jnp.concatenate([data.goal[None, :2], base[None, :2], blocks[:, :2]]),
        size=jnp.concatenate(
            [
                data.goal[None, 2:],
                boxes.robot_size(robot, base[2])[None],
                boxes.block_sizes(data.shape, blocks[:, 2]),
            ]
        ),
        label=jnp.concatenate([jnp.arange(2), kinds]).astype(jnp.int32),
        is_robot=jnp.arange(2 + len(blocks)) == 1,
    )
