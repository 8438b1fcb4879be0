"""The Panda's controller: actions to aims of its servos, one step at a time.

Action (5,): the tool centre point's x, y, z (25 mm a step, world axes) and yaw about the vertical
(0.1 rad); the hand points straight down. It is ManiSkill's pd_ee_delta_pose without tilts, and
slower because the real arm could not follow. The last number is the gripper: -1 closes it and
presses, 1 opens it to 8 cm. Aims move from the last aims, not from the measured joints, so that a
resting action holds the arm still.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from . import kinematics
from .frames import Frame, about_z

ACTION_NAMES = ("x", "y", "z", "yaw", "gripper")
GRIP_RANGE = (-0.01, 0.04)  # aims of a finger, metres; below 0 it presses
MOVE_STEP, TURN_STEP = 0.025, 0.1  # metres, rad a control step
_DOWN = np.array([1.0, -1.0, -1.0], np.float32)  # axes of a hand that points down at yaw 0
_LEASH = 0.3  # rad; more than this ahead of a blocked joint no aim runs, all torque is used by then


def aim(
    target: Float[Array, "8"],
    q: Float[Array, "7"],
    action: Float[Array, "5"],
    *,
    rest: Float[Array, "7"],
    dt: float,
) -> Float[Array, "8"]:
    """The servos' next targets: seven joints (rad) and the opening of a finger (metres).

    `target` are the last ones, `q` the measured joints; the action is in [-1, 1]. Where the hand
    leaves it free, the arm keeps near to its posture of rest. In the `dt` seconds of a control step
    no aim moves further than its joint can.
    """
    arm, now = target[:7], kinematics.tcp(target[:7])
    yaw = jnp.arctan2(now.rotation[1, 0], now.rotation[0, 0]) + TURN_STEP * action[3]
    goal = Frame(now.position + MOVE_STEP * action[:3], about_z(yaw) * _DOWN)
    wanted = kinematics.reach(arm, goal, rest=rest)
    limit = kinematics.JOINT_SPEED * dt
    wanted = arm + jnp.clip(wanted - arm, -limit, limit)
    wanted = jnp.clip(wanted, q - _LEASH, q + _LEASH)
    wanted = jnp.clip(wanted, *kinematics.JOINT_RANGE.T)
    low, high = GRIP_RANGE
    return jnp.concatenate([wanted, low + (high - low) * (action[-1:] + 1) / 2])
