"""MJCF of a planar scene: a robot and blocks that slide on a table, seen from above.

Every free body has two slide joints (x, y) and a hinge (yaw) at its centre of mass, so a joint's
position *is* the pose and no forward kinematics is needed to read the scene. The table is friction
loss on those joints, the walls are joint limits (set each substep by the caller, because they
depend on the body's angle), and contacts are an explicit list of pairs with the friction
coefficient that Chipmunk would use: the product of both surfaces'. MuJoCo alone would take the
larger of the two.

The text is generated, not shipped as a file, because robots and block lists combine freely.
"""

import math
from typing import NamedTuple

import mujoco
import numpy as np

from .shapes import Capsule, Shape, finger

__all__ = [
    "DISC_INERTIA",
    "DISC_MASS",
    "FINGER_MASS",
    "FINGER_OPEN",
    "FINGER_RATE",
    "FINGER_TORQUE",
    "PIVOT",
    "RobotShape",
    "build",
    "finger_armature",
    "gripper",
]

BLOCK_FRICTION, BODY_FRICTION, FINGER_FRICTION = 0.5, 0.5, 5.0  # Chipmunk's, per surface
BLOCK_MASS, FINGER_MASS = 0.01, 0.125
DISC_MASS, DISC_INERTIA = 1.0, 0.020
TABLE_FORCE, TABLE_TORQUE = 1.5, 0.1  # most that the table resists a block with
FINGER_TORQUE, FINGER_RATE = 4.0, 1.0  # largest, of the finger motors
# MuJoCo's contacts are springs whose stiffness scales with the lighter body's mass, so a gripped
# block of 0.01 would be pierced. At this impedance it yields by 0.005 at the largest grip.
_HARD = "0.999 0.999 0.01"
PIVOT = (0.09, 0.02)  # of the right finger, in the robot's frame
FINGER_OPEN = math.pi / 8  # rad from closed (parallel) to fully open


class RobotShape(NamedTuple):
    """A robot's base and whether it has fingers."""

    base: Shape
    mass: float
    fingers: bool


def gripper() -> RobotShape:
    """A disc of radius 0.2 with two fingers; forward is +y."""
    angles = np.arange(32) * math.pi / 16
    ring = 0.2 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    base = Shape(ring, (Capsule((0.0, 0.0), (0.0, 0.0), 0.2),), DISC_INERTIA)
    return RobotShape(base, DISC_MASS, True)


def finger_armature(timestep: float) -> float:
    """Rotor inertia of the finger motors.

    The motor is a velocity servo applied as an explicit force. A force that reaches the wanted rate
    (at most 1 rad/s) in one substep is tiny for so light a finger, so a blocked finger would hardly
    grip; Chipmunk's motor grips with its full torque. This inertia makes the two agree.
    """
    return FINGER_TORQUE * timestep / FINGER_RATE


def _geom(name: str, capsule: Capsule) -> str:
    (ax, ay), (bx, by), r = capsule
    if (ax, ay) == (bx, by):
        return f'<geom name="{name}" type="sphere" size="{r}" pos="{ax} {ay} 0"/>'
    return f'<geom name="{name}" type="capsule" size="{r}" fromto="{ax} {ay} 0 {bx} {by} 0"/>'


def _geoms(body: str, shape: Shape) -> tuple[list[str], str]:
    names = [f"{body}_{i}" for i in range(len(shape.capsules))]
    return names, "".join(_geom(n, c) for n, c in zip(names, shape.capsules, strict=True))


def _free_planar(
    name: str, shape: Shape, mass: float, loss: tuple[float, float], inner: str
) -> str:
    """A body that slides and turns; `loss` is the table's largest force and torque."""
    i = shape.inertia
    slide = f'type="slide" limited="true" range="-1 1" frictionloss="{loss[0]}"'
    return (
        f'<body name="{name}"><inertial pos="0 0 0" mass="{mass}" diaginertia="{i} {i} {i}"/>'
        f'<joint name="{name}_x" axis="1 0 0" {slide}/>'
        f'<joint name="{name}_y" axis="0 1 0" {slide}/>'
        f'<joint name="{name}_yaw" axis="0 0 1" type="hinge" frictionloss="{loss[1]}"/>'
        f"{inner}</body>"
    )


def _finger(side: int, timestep: float) -> tuple[list[str], str]:
    name, shape = ("left", "right")[side > 0] + "_finger", finger(side)
    # Centre of mass of the two arms, weighted by length; the inertia moves there from the pivot.
    (_, elbow, _), (_, wrist, _) = shape.capsules
    x = (0.22 * 0.0 + 0.14 * (elbow[0] + wrist[0]) / 2) / 0.36
    y = (0.22 * elbow[1] / 2 + 0.14 * (elbow[1] + wrist[1]) / 2) / 0.36
    inertia = shape.inertia - FINGER_MASS * (x * x + y * y)
    i = inertia
    low, high = (0.0, FINGER_OPEN) if side < 0 else (-FINGER_OPEN, 0.0)
    names, geoms = _geoms(name, shape)
    return names, (
        f'<body name="{name}" pos="{side * PIVOT[0]} {PIVOT[1]} 0">'
        f'<inertial pos="{x} {y} 0" mass="{FINGER_MASS}" diaginertia="{i} {i} {i}"/>'
        f'<joint name="{name}" type="hinge" axis="0 0 1" limited="true" range="{low} {high}"'
        f' armature="{finger_armature(timestep)}"/>{geoms}</body>'
    )


def _pairs(surfaces: list[tuple[list[str], float]], robot_parts: int) -> str:
    """Contact pairs between every two bodies, but not among the robot's own parts."""
    text = []
    for i, (first, mu1) in enumerate(surfaces):
        for second, mu2 in surfaces[max(i + 1, robot_parts) :]:
            mu = mu1 * mu2
            text += [
                f'<pair geom1="{a}" geom2="{b}" condim="3" friction="{mu} {mu}"/>'
                for a in first
                for b in second
            ]
    return "".join(text)


def build(
    robot: RobotShape,
    blocks: list[Shape],
    *,
    timestep: float,
    iterations: int,
    max_contacts: int,
) -> mujoco.MjModel:
    """Compile the scene. Body names: robot, left_finger, right_finger, block_0, block_1, ..."""
    base_names, base_geoms = _geoms("robot", robot.base)
    surfaces, inner = [(base_names, BODY_FRICTION)], base_geoms
    for side in (-1, 1) if robot.fingers else ():
        names, text = _finger(side, timestep)
        surfaces.append((names, FINGER_FRICTION))
        inner += text
    robot_parts = len(surfaces)
    bodies = _free_planar("robot", robot.base, robot.mass, (0.0, 0.0), inner)
    for i, shape in enumerate(blocks):
        names, geoms = _geoms(f"block_{i}", shape)
        surfaces.append((names, BLOCK_FRICTION))
        bodies += _free_planar(f"block_{i}", shape, BLOCK_MASS, (TABLE_FORCE, TABLE_TORQUE), geoms)
    return mujoco.MjModel.from_xml_string(f"""
<mujoco model="planar">
  <compiler angle="radian"/>
  <option timestep="{timestep}" gravity="0 0 0" solver="Newton" iterations="{iterations}"
          ls_iterations="5" cone="pyramidal" integrator="Euler">
    <flag eulerdamp="disable"/>
  </option>
  <custom><numeric name="max_contact_points" data="{max_contacts}"/></custom>
  <default>
    <geom contype="0" conaffinity="0"/>
    <joint solreflimit="{2 * timestep} 1" solreffriction="{2 * timestep} 1"
           solimplimit="{_HARD}" solimpfriction="0.98 0.98 0.01"/>
    <pair solref="{2 * timestep} 1" solimp="{_HARD}"/>
  </default>
  <worldbody>{bodies}</worldbody>
  <contact>{_pairs(surfaces, robot_parts)}</contact>
</mujoco>""")
