"""MJCF of a planar scene for the MJX engine: the gripper and blocks on a table, from above.

Every free body has two slide joints (x, y) and a hinge (yaw) at its centre of mass, so a joint's
position *is* the pose; a finger hangs on one hinge at its pivot. The table is friction loss on the
blocks' joints, the walls are joint limits, and contacts are a list of pairs with Chipmunk's
friction, the product of both surfaces'. A few capsules stand for each outline, flush along edges.
"""

import math
from typing import NamedTuple

import jax.numpy as jnp
import mujoco
import numpy as np

from . import robots, shapes
from .joints import FINGER_RATE
from .physics import BLOCK_FRICTION, BLOCK_MASS

FINGER_TORQUE = 4.0  # largest, of the original's finger motors
TABLE_FORCE, TABLE_TORQUE = 1.5, 0.1  # most that the original's table resists a block with
FINGER_RADIUS = 0.025  # half a finger's thickness
_RADIUS = 0.04  # rounds a polygon's corners by at most 0.02; a star's notches are near the true
_MAX_CONTACTS = 16  # that a substep resolves; the deepest count
# MuJoCo's contacts are springs whose stiffness scales with the lighter body's mass, so a gripped
# block of 0.01 would be pierced. At this impedance it yields by 0.005 at the largest grip.
_HARD = "0.999 0.999 0.01"


class Capsule(NamedTuple):
    """All points within `radius` of a segment; a disc if the segment's ends are one point."""

    start: tuple[float, float]
    end: tuple[float, float]
    radius: float


def disc_capsules(radius: float) -> tuple[Capsule, ...]:
    """A disc around the origin."""
    return (Capsule((0.0, 0.0), (0.0, 0.0), radius),)


def block_capsules(name: str) -> tuple[Capsule, ...]:
    """Capsules of a block, one of `shapes.SHAPES`, in its own frame (arena units)."""
    if name == "circle":
        return disc_capsules(shapes.SIZE)
    corners = shapes.outline(name)
    size = np.linalg.norm(corners[0])
    if name == "star":  # from its centre to its tips
        ends = corners[::2] * (1 - _RADIUS / size)
        return tuple(Capsule((0.0, 0.0), (*end,), _RADIUS) for end in ends)
    # Along the edges, their outer sides flush with them.
    inner = corners * (1 - _RADIUS / (size * math.cos(math.pi / len(corners))))
    pairs = zip(inner, np.roll(inner, -1, axis=0), strict=True)
    return tuple(Capsule((*a,), (*b,), _RADIUS) for a, b in pairs)


def finger_capsules(part: robots.Part) -> tuple[Capsule, ...]:
    """Capsules of a gripper's finger, upper arm then forearm, in its pivot's frame.

    The forearm is bent about the outer corner of the elbow, so the middle lines of both arms meet
    nearly, not quite. The elbow stands out by 0.002.
    """
    _, fore = part.boxes
    along = np.array([-math.sin(fore.angle), math.cos(fore.angle)])
    middle, half = np.array(fore.center), fore.half[1]
    elbow = middle - half * along
    wrist = middle + (half - FINGER_RADIUS) * along
    upper = Capsule((0.0, 0.0), (0.0, elbow[1]), FINGER_RADIUS)
    return upper, Capsule((*elbow,), (*wrist,), FINGER_RADIUS)


def finger_armature(timestep: float) -> float:
    """Rotor inertia of the finger motors.

    The motor is a velocity servo applied as an explicit force. A force that reaches the wanted rate
    (at most 1 rad/s) in one substep is tiny for so light a finger, so a blocked finger would hardly
    grip; Chipmunk's motor grips with its full torque. This inertia makes the two agree.
    """
    return FINGER_TORQUE * timestep / FINGER_RATE


def _geoms(body: str, capsules: tuple[Capsule, ...]) -> tuple[list[str], str]:
    """Names of a body's geoms, and their MJCF."""
    names, text = [f"{body}_{i}" for i in range(len(capsules))], ""
    for name, ((ax, ay), (bx, by), r) in zip(names, capsules, strict=True):
        shape = f'type="capsule" size="{r}" fromto="{ax} {ay} 0 {bx} {by} 0"'
        if (ax, ay) == (bx, by):
            shape = f'type="sphere" size="{r}" pos="{ax} {ay} 0"'
        text += f'<geom name="{name}" {shape}/>'
    return names, text


def _inertial(mass: float, inertia: float) -> str:
    return f'<inertial pos="0 0 0" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/>'


def _free_planar(name: str, inertial: str, loss: tuple[float, float], inner: str) -> str:
    """MJCF of a body that slides and turns; `loss` is the table's largest force and torque."""
    slide = f'type="slide" limited="true" range="-1 1" frictionloss="{loss[0]}"'
    return (
        f'<body name="{name}">{inertial}'
        f'<joint name="{name}_x" axis="1 0 0" {slide}/>'
        f'<joint name="{name}_y" axis="0 1 0" {slide}/>'
        f'<joint name="{name}_yaw" axis="0 0 1" type="hinge" frictionloss="{loss[1]}"/>'
        f"{inner}</body>"
    )


def _finger(name: str, side: int, part: robots.Part, geoms: str, timestep: float) -> str:
    x, y = robots.PIVOTS[side]
    low, high = ((0.0, robots.FINGER_OPEN), (-robots.FINGER_OPEN, 0.0))[side]
    return (
        f'<body name="{name}" pos="{x} {y} 0">{_inertial(part.mass, part.inertia)}'
        f'<joint name="{name}" type="hinge" axis="0 0 1" limited="true" range="{low} {high}"'
        f' armature="{finger_armature(timestep)}"/>{geoms}</body>'
    )


def _pairs(surfaces: list[tuple[list[str], float]], robot_parts: int) -> str:
    """Contact pairs between all bodies, except among the robot's own parts."""
    text = []
    for i, (first, mu1) in enumerate(surfaces):
        for second, mu2 in surfaces[max(i + 1, robot_parts) :]:
            slide = f'condim="3" friction="{mu1 * mu2} {mu1 * mu2}"'
            text += [f'<pair geom1="{a}" geom2="{b}" {slide}/>' for a in first for b in second]
    return "".join(text)


def build(blocks: tuple[str, ...], *, timestep: float, iterations: int) -> mujoco.MjModel:
    """Compiles the scene of the gripper and blocks.

    Joint positions are the gripper's x, y (arena units), yaw, left and right finger (rad, relative
    to the base), then x, y, yaw of each block. Bodies: robot, left_finger, right_finger, block_0,
    block_1, ...

    Blocks are shapes of `shapes.SHAPES`; `timestep` is a substep in s, `iterations` those of the
    contact solver.
    """
    base, *fingers = robots.robot("gripper").parts
    names, inner = _geoms("robot", disc_capsules(base.radius))
    surfaces = [(names, base.friction)]
    for side, part in enumerate(fingers):
        name = ("left_finger", "right_finger")[side]
        names, geoms = _geoms(name, finger_capsules(part))
        surfaces.append((names, part.friction))
        inner += _finger(name, side, part, geoms, timestep)
    bodies = _free_planar("robot", _inertial(base.mass, base.inertia), (0.0, 0.0), inner)
    index = jnp.array([shapes.SHAPES.index(shape) for shape in blocks], jnp.int32)
    inertias = 1.0 / np.asarray(shapes.blocks(index).inverse_inertia, np.float64)
    for i, (shape, inertia) in enumerate(zip(blocks, inertias, strict=True)):
        names, geoms = _geoms(f"block_{i}", block_capsules(shape))
        surfaces.append((names, BLOCK_FRICTION))
        inertial = _inertial(BLOCK_MASS, inertia)
        bodies += _free_planar(f"block_{i}", inertial, (TABLE_FORCE, TABLE_TORQUE), geoms)
    return mujoco.MjModel.from_xml_string(f"""
<mujoco model="planar">
  <compiler angle="radian"/>
  <option timestep="{timestep}" gravity="0 0 0" solver="Newton" iterations="{iterations}"
          ls_iterations="5" cone="pyramidal" integrator="Euler">
    <flag eulerdamp="disable"/>
  </option>
  <custom><numeric name="max_contact_points" data="{_MAX_CONTACTS}"/></custom>
  <default>
    <geom contype="0" conaffinity="0"/>
    <joint solreflimit="{2 * timestep} 1" solreffriction="{2 * timestep} 1"
           solimplimit="{_HARD}" solimpfriction="0.98 0.98 0.01"/>
    <pair solref="{2 * timestep} 1" solimp="{_HARD}"/>
  </default>
  <worldbody>{bodies}</worldbody>
  <contact>{_pairs(surfaces, 1 + len(fingers))}</contact>
</mujoco>""")
