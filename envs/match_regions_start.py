"""How an episode of MatchRegions starts: what the variant draws, and varied starts for training."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key, PRNGKeyArray

from . import match_regions_layout as layouts
from . import robots
from .joints import Strengths
from .match_regions_options import PRESETS, Preset
from .robots import Robot

__all__ = ["Varied", "looks", "places", "robot_pose", "strengths", "varied"]


class Varied(NamedTuple):
    """A start that may have been varied for training."""

    layout: layouts.Layout
    marked: Bool[Array, ""]  # whether it was
    placed: Int[Array, ""]  # the block that was put into the region, or -1


def looks(
    keys: Key[Array, "2"],
    variant: str,
    shape: Int[Array, "B"],
    colour: Int[Array, "B"],
    targets: int,
) -> tuple[Int[Array, "B"], Int[Array, "B"]]:
    """Shapes and colours of the blocks: those given, or drawn with two keys.

    The first `targets` blocks are the targets.
    """
    if variant in ("shape", "all"):
        shape = layouts.shapes(keys[0], len(shape))
    if variant in ("color", "all"):
        colour = layouts.colours(keys[1], colour, targets)
    return shape, colour


def strengths(key: PRNGKeyArray, variant: str, preset: Preset) -> Strengths:
    """The largest forces: the preset's, or drawn from its ranges."""
    if variant not in ("dynamics", "all"):
        return Strengths(*(jnp.float32(s) for s in preset.strengths))
    drawn = layouts.dynamics(key)
    (low, high), (least, most) = PRESETS["xmagical"].drives, preset.drives
    if (least, most) == (low, high):
        return drawn
    return drawn._replace(drive=least + (drawn.drive - low) * (most - least) / (high - low))


def places(
    key: PRNGKeyArray,
    variant: str,
    blocks: tuple[str, ...],
    *,
    robot: Robot,
    radii: Float[Array, "B"],
    arena: float,
) -> layouts.Layout:
    """Where things start: the Demo layout, near it, or anywhere."""
    if variant in ("layout", "all"):
        return layouts.scatter(key, robot, radii, arena=arena)
    layout = layouts.Layout(
        jnp.array(layouts.DEMO_ROBOT),
        jnp.array([layouts.DEMO_BLOCKS[b] for b in blocks]),
        jnp.array(layouts.DEMO_GOAL),
        jnp.zeros((), bool),
    )
    return layouts.jitter(key, layout, arena=arena) if variant == "jitter" else layout


def varied(
    keys: Key[Array, "2"],
    layout: layouts.Layout,
    *,
    share: float,
    targets: int,
    robot: Robot,
    radii: Float[Array, "B"],
    arena: float,
) -> Varied:
    """In a `share` of the episodes the robot anywhere and, two times in three, one target inside.

    Takes two keys; the first `targets` blocks are the targets.
    """
    none = jnp.full((), -1, jnp.int32)
    if not share:
        return Varied(layout, jnp.zeros((), bool), none)
    vary = jax.random.uniform(keys[0]) < share
    key_robot, key_some, key_which, key_where = jax.random.split(keys[1], 4)
    which = jax.random.randint(key_which, (), 0, targets, jnp.int32)
    some = vary & (jax.random.uniform(key_some) < 2 / 3)
    unit = jax.random.uniform(key_where, (3,), minval=-1.0)
    goal = layout.goal
    inside = jnp.concatenate([goal[:2] + 0.35 * goal[2:] * unit[:2], jnp.pi * unit[2:]])
    blocks = jnp.where(some, layout.blocks.at[which].set(inside), layout.blocks)
    pose, unplaced = layouts.place_robot(key_robot, robot, blocks, radii, None, arena=arena)
    layout = layout._replace(
        robot=jnp.where(vary, pose, layout.robot),
        blocks=blocks,
        unplaced=layout.unplaced | (vary & unplaced),
    )
    return Varied(layout, vary, jnp.where(some, which, none))


def robot_pose(robot: Robot, base: Float[Array, "3"]) -> Float[Array, "P 3"]:
    """Poses of the robot's parts with open fingers, from its base's."""
    if not robot.has_fingers:
        return base[None]
    c, s = jnp.cos(base[2]), jnp.sin(base[2])
    pivots = jnp.asarray(robots.PIVOTS, jnp.float32) @ jnp.array([[c, s], [-s, c]])
    angle = base[2] + robots.FINGER_OPEN * jnp.array([1.0, -1.0])
    fingers = jnp.concatenate([base[:2] + pivots, angle[:, None]], axis=1)
    return jnp.concatenate([base[None], fingers])
