"""The simulators of MAGICAL's tasks: two presets of physics, and two engines that solve them.

Physics:
  "xmagical"  arena 1.1, block mass 0.01, drive force 5: blocks stop within a hundredth of a second
  "magical"   the original MAGICAL's: arena 1.0, block mass 0.5, drive force 3, so blocks coast;
              `physics` says what else differs

Engines: "impulse", our own solver (`planar.physics`), which follows the original closely and serves
every option; or "mjx", MuJoCo's (`planar.mjx_engine`), which serves the gripper, fixed shapes and
"xmagical" physics.
"""

import functools
from typing import NamedTuple

from gril_jax.envs.checks import check_counts, check_known
from gril_jax.envs.planar import robots, shapes
from gril_jax.envs.planar.joints import Strengths
from gril_jax.envs.planar.mjx_engine import MjxPhysics
from gril_jax.envs.planar.physics import Physics

from .physics import MagicalPhysics

CONTROL_HZ = 8.0
_SOLVING = {"impulse": (10, 6), "mjx": (5, 2)}  # substeps and iterations of each engine

Engine = Physics | MjxPhysics


class Preset(NamedTuple):
    """One of the two simulators' physics."""

    arena: float  # half the side, arena units
    block_mass: float
    strengths: Strengths
    drives: tuple[float, float]  # range of the drive's force in the Dynamics variant
    reverse: float  # fastest backwards, units/s


PRESETS = {
    "xmagical": Preset(1.1, 0.01, Strengths(5.0, 1.0, 4.0, 1.5, 0.1), (3.2, 5.5), 0.8),
    "magical": Preset(1.0, 0.5, Strengths(3.0, 1.0, 4.0, 1.5, 0.1), (2.2, 3.5), 0.6),
}


def engine(
    name: str,
    robot: str,
    physics: str,
    variant: str,
    blocks: tuple[int, ...],
    *,
    substeps: int | None,
    iterations: int | None,
) -> Engine:
    """The engine of that name for a task's options; `blocks` index `planar.shapes.SHAPES`.

    Raises:
      ValueError: a name is unknown, a count is below 1, or the engine does not serve the task.
    """
    check_known("robot", robot, robots.ROBOTS)
    check_known("physics", physics, [*PRESETS])
    check_known("engine", name, [*_SOLVING])
    preset, own = PRESETS[physics], _SOLVING[name]
    counts = {
        "substeps": own[0] if substeps is None else substeps,
        "iterations": own[1] if iterations is None else iterations,
    }
    check_counts(**counts)
    common = dict(arena=preset.arena, control_hz=CONTROL_HZ, **counts)
    if name == "impulse":
        kind = MagicalPhysics if physics == "magical" else Physics
        return _impulses(kind, robot, len(blocks), block_mass=preset.block_mass, **common)
    if robot != "gripper":
        raise ValueError(f"engine 'mjx' serves the robot 'gripper' only, not {robot!r}")
    if physics != "xmagical":
        raise ValueError(f"engine 'mjx' serves the physics 'xmagical' only, not {physics!r}")
    if variant in ("shape", "all"):
        raise ValueError(f"engine 'mjx' has fixed shapes and cannot serve the variant {variant!r}")
    return MjxPhysics(tuple(shapes.SHAPES[s] for s in blocks), **common)


@functools.cache
def _impulses(kind: type[Physics], robot: str, num_blocks: int, **options) -> Physics:
    """The physics engine, shared by all tasks with the same motion: it takes longest to trace."""
    return kind(robots.robot(robot), num_blocks, **options)
