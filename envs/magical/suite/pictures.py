"""Pictures of a task: outlines that the host paints, and pixels made inside compiled programs."""

from typing import Any

import jax
import numpy as np
from gril_jax.envs.base import Outline
from gril_jax.envs.magical import raster, scene
from gril_jax.envs.magical.layout import COLOURS
from gril_jax.envs.planar.robots import Robot
from gril_jax.envs.planar.shapes import NOTHING, SHAPES
from jaxtyping import Array, UInt8

from .state import SuiteData


def outlines(
    data: SuiteData, robot: Robot, *, arena: float, look: scene.Look, robot_first: bool
) -> list[Outline]:
    """The outlines of one moment, to be painted (host side)."""
    data, parts = jax.tree.map(np.asarray, data), len(robot.parts)
    blocks = np.flatnonzero(data.shape != NOTHING)
    named = [(COLOURS[data.colour[b]], SHAPES[data.shape[b]]) for b in blocks]
    pose = data.pose[np.concatenate([np.arange(parts), parts + blocks])].astype(np.float64)
    regions = [
        (COLOURS[colour], box.astype(np.float64))
        for colour, box in zip(data.region_colour, data.regions, strict=True)
        if box[2] > 0
    ]
    return scene.outlines(robot, named, arena, pose, regions, look=look, robot_first=robot_first)


def render(data: SuiteData, robot: Robot, *, arena: float, **options: Any) -> UInt8[Array, "S S 3"]:
    """The same as an image, inside jit; see `raster.render` for its options."""
    bodies = data.pose[: len(robot.parts) + len(data.shape)]
    drawn = raster.Painting(bodies, data.shape, data.colour, data.regions, data.region_colour)
    return raster.render(drawn, robot=robot.name, arena=arena, **options)
