"""Controllers of the Panda: actions to aims of its servos, one step at a time.

  "joint_delta"   (8,) seven joints, at most 0.1 rad a step (playground's PandaPickCube: 2 rad/s)
  "ee_delta"      (7,) the tool centre point: x, y, z (25 mm), turn about x, y, z (0.1 rad), world
                  axes (ManiSkill's pd_ee_delta_pose, slower because the real arm could not follow)
  "ee_delta_yaw"  (5,) x, y, z, and yaw about the vertical; the hand points straight down

The last action of each is the gripper: -1 closes it and presses, 1 opens it to 8 cm. Aims move from
the last aims, not from the measured joints, so that a resting action holds the arm still.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from . import kinematics
from .frames import Frame, about_z, compose, rotation

__all__ = ["ACTION_NAMES", "CONTROLLERS", "GRIP_RANGE", "aim"]

CONTROLLERS = ("joint_delta", "ee_delta", "ee_delta_yaw")
_MOVES, _TURNS = ("x", "y", "z"), ("turn x", "turn y", "turn z")
ACTION_NAMES = {
    "joint_delta": (*(f"joint {i}" for i in range(1, 8)), "gripper"),
    "ee_delta": (*_MOVES, *_TURNS, "gripper"),
    "ee_delta_yaw": (*_MOVES, "yaw", "gripper"),
}
GRIP_RANGE = (-0.01, 0.04)  # aims of a finger, metres; below 0 it presses

_JOINT_STEP, _MOVE_STEP, _TURN_STEP = 0.1, 0.025, 0.1  # rad, metres, rad a control step
_DOWN = np.array([1.0, -1.0, -1.0], np.float32)  # axes of a hand that points down at yaw 0
_LEASH = 0.3  # rad; more than this ahead of a blocked joint no aim runs, all torque is used by then


def aim(
    controller: str,
    target: Float[Array, "8"],
    q: Float[Array, "7"],
    action: Float[Array, "A"],
    *,
    rest: Float[Array, "7"],
    dt: float,
) -> Float[Array, "8"]:
    """The servos' next aims: seven joints (rad) and the opening of a finger (metres).

    Args:
      controller: one of `CONTROLLERS`.
      target: the last aims.
      q: the measured joints.
      action: in [-1, 1].
      rest: posture that the arm keeps near to where the hand leaves it free.
      dt: length of a control step, s; no aim moves faster than its joint can.
    """
    arm = target[:7]
    if controller == "joint_delta":
        wanted = arm + _JOINT_STEP * action[:7]
    else:
        wanted = kinematics.reach(arm, _goal(controller, arm, action), rest=rest)
    limit = kinematics.JOINT_SPEED * dt
    wanted = arm + jnp.clip(wanted - arm, -limit, limit)
    wanted = jnp.clip(wanted, q - _LEASH, q + _LEASH)
    wanted = jnp.clip(wanted, *kinematics.JOINT_RANGE.T)
    low, high = GRIP_RANGE
    grip = low + (high - low) * (action[-1:] + 1) / 2
    return jnp.concatenate([wanted, grip])


def _goal(controller: str, arm: Float[Array, "7"], action: Float[Array, "A"]) -> Frame:
    """Where the tool centre point should be after this step."""
    now = kinematics.tcp(arm)
    place = now.position + _MOVE_STEP * action[:3]
    if controller == "ee_delta":
        return Frame(place, compose(_turn(_TURN_STEP * action[3:6]), now.rotation))
    forward = now.rotation[:, 0]
    yaw = jnp.arctan2(forward[1], forward[0]) + _TURN_STEP * action[3]
    return Frame(place, about_z(yaw) * _DOWN)


def _turn(vector: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """A small turn: its axis times its angle."""
    quaternion = jnp.concatenate([jnp.ones(1), vector / 2])
    return rotation(quaternion / jnp.sqrt(jnp.sum(quaternion**2)))
