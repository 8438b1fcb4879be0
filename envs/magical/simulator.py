"""The simulators of MAGICAL's tasks: two presets of physics, three engines, and their commands.

The physics "xmagical" has an arena of 1.1 and blocks that stop at once; "magical", the original's,
an arena of 1 and blocks that coast; see `physics`. Engines: "impulse", our own solver in JAX with
gradients (`planar.physics`); "kernel", the same in one NVIDIA Warp kernel, many times as fast and
without gradients; "mjx", MuJoCo's, which serves the gripper, fixed shapes and "xmagical" alone.
"""

import functools
import importlib
import importlib.util
import warnings
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.checks import check_counts, check_known
from gril_jax.envs.planar import robots, shapes
from gril_jax.envs.planar.joints import Command, Strengths
from gril_jax.envs.planar.mjx_engine import MjxPhysics
from gril_jax.envs.planar.physics import Physics
from gril_jax.envs.planar.robots import FINGER_OPEN
from jaxtyping import Array, Float, Int

from .physics import MagicalPhysics

CONTROL_HZ = 8.0
_MAX_SPEED = 0.8  # units/s
_OFFSET = 1.5  # rad: how far from the heading MAGICAL's turns aim
TURN_GAIN = 40.0  # rad/s for a turn of 1, before saturation: bang-bang beyond 0.0625
_SOLVING = {
    "impulse": (10, 6),
    "kernel": (10, 6),
    "mjx": (5, 2),
}  # substeps and iterations of each engine

Engine = Any  # with the methods of `Physics`: rest, step, settle, clearance


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


def resolved(engine: str) -> str:
    """The engine's name, where "auto" is the fastest one that serves all of JAX's devices.

    It warns where the kernel would serve them, but its package is not installed.

    Raises:
      ValueError: there is no such engine.
    """
    check_known("engine", engine, ["auto", *_SOLVING])
    if engine != "auto":
        return engine
    served = all(d.platform == "cpu" or d.device_kind.startswith("NVIDIA") for d in jax.devices())
    if served and importlib.util.find_spec("warp") is None:
        warnings.warn(
            "physics run many times slower than they could: pip install warp-lang", stacklevel=2
        )
        served = False
    return "kernel" if served else "impulse"


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
    """The engine of a `resolved` name for a task's options; `blocks` index `planar.shapes.SHAPES`.

    Raises:
      ValueError: a name is unknown, a count is below 1, or the engine does not serve the task.
    """
    check_known("robot", robot, robots.ROBOTS)
    check_known("physics", physics, [*PRESETS])
    preset, own = PRESETS[physics], _SOLVING[name]
    counts = {
        "substeps": own[0] if substeps is None else substeps,
        "iterations": own[1] if iterations is None else iterations,
    }
    check_counts(**counts)
    common = dict(arena=preset.arena, control_hz=CONTROL_HZ, **counts)
    if name in ("impulse", "kernel"):
        kind = MagicalPhysics if physics == "magical" else Physics
        own = _impulses(kind, robot, len(blocks), block_mass=preset.block_mass, **common)
        return own if name == "impulse" else _in_a_kernel(own)
    if robot != "gripper":
        raise ValueError(f"engine 'mjx' serves the robot 'gripper' only, not {robot!r}")
    if physics != "xmagical":
        raise ValueError(f"engine 'mjx' serves the physics 'xmagical' only, not {physics!r}")
    if variant in ("shape", "countplus", "all"):
        raise ValueError(f"engine 'mjx' has fixed shapes and cannot serve the variant {variant!r}")
    if shapes.NOTHING in blocks:
        raise ValueError(
            "engine 'mjx' has fixed blocks, but the task has room for more than it has"
        )
    return MjxPhysics(tuple(shapes.SHAPES[s] for s in blocks), **common)


@functools.cache
def _impulses(kind: type[Physics], robot: str, num_blocks: int, **options) -> Physics:
    """The physics engine, shared by all tasks with the same motion: it takes longest to trace."""
    return kind(robots.robot(robot), num_blocks, **options)


@functools.cache
def _in_a_kernel(physics: Physics) -> Engine:
    """The engine that computes the same in a kernel."""
    try:
        kernel = importlib.import_module("gril_jax.envs.planar.kernel.engine")
    except ModuleNotFoundError as error:
        raise ValueError(
            f"engine is 'kernel', which needs a package: pip install warp-lang ({error})"
        ) from error
    return kernel.KernelPhysics(physics, pins=isinstance(physics, MagicalPhysics))


def command(action: Float[Array, "A"], *, dt: float) -> Command:
    """x-magical's command for an action; `dt` is the substep in s."""
    grip = action[2] if action.shape[0] > 2 else jnp.zeros(())
    speed = jnp.clip(action[0], -PRESETS["xmagical"].reverse, _MAX_SPEED)
    opening = jnp.clip(FINGER_OPEN - grip, 0.0, FINGER_OPEN)
    # A heading offset of a turns at a / (2 dt), because half of it is done when the servo acts.
    return Command(speed, 2 * dt * TURN_GAIN * action[1], opening)


def rounded_command(action: Float[Array, "A"]) -> Command:
    """MAGICAL's command nearest to an action: values past a half count, any grip above 0 closes."""
    grip = action[2] if action.shape[0] > 2 else jnp.zeros(())
    speed = jnp.where(action[0] > 0.5, _MAX_SPEED, 0.0)
    speed = jnp.where(action[0] < -0.5, -PRESETS["magical"].reverse, speed)
    turn = jnp.where(jnp.abs(action[1]) > 0.5, _OFFSET * jnp.sign(action[1]), 0.0)
    return Command(speed, turn, jnp.where(grip > 0, 0.0, FINGER_OPEN))


def commanded(action: Float[Array, "A"], *, physics: str, dt: float) -> Command:
    """The command for an action, clipped to [-1, 1], of a preset."""
    action = jnp.clip(action, -1.0, 1.0)
    if physics == "magical":
        return rounded_command(action)
    return command(action, dt=dt)


def from_magical(ids: Int[np.ndarray, "*T"]) -> Float[np.ndarray, "*T 3"]:
    """The actions with MAGICAL's numbers 9 * grip + 3 * turn + drive, from 0 to 17.

    drive: 0 none, 1 forward, 2 reverse. turn: 0 none, 1 left, 2 right. grip: 0 open, 1 close.

    >>> from_magical(np.array([0, 1, 12])).tolist()
    [[0.0, 0.0, -1.0], [1.0, 0.0, -1.0], [0.0, 1.0, 1.0]]
    """
    ids = np.asarray(ids)
    if ids.size and not (0 <= ids.min() and ids.max() < 18):
        raise ValueError(f"ids reach from {ids.min()} to {ids.max()}, but must lie in 0 to 17")
    way = np.array([0.0, 1.0, -1.0], np.float32)
    grip = np.array([-1.0, 1.0], np.float32)
    return np.stack([way[ids % 3], way[ids // 3 % 3], grip[ids // 9]], axis=-1)
