"""Kinematics of the Franka Panda, joints that reach a pose, and the controller of its servos.

Numbers are the maker's (`franka_description`): the base is at the origin, x points forward, y to
the robot's left, z up; lengths are metres, angles rad. Rotations are matrices whose columns are the
turned axes, quaternions (w, x, y, z); products are sums of elementwise ones, as a matrix product of
a graphics processor may round its factors to ten bits. Functions take one arm; batch with vmap.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

LINK_OFFSETS = (
    (0.0, 0.0, 0.333), (0.0, 0.0, 0.0), (0.0, -0.316, 0.0), (0.0825, 0.0, 0.0),
    (-0.0825, 0.384, 0.0), (0.0, 0.0, 0.0), (0.088, 0.0, 0.0),
)  # fmt: skip
LINK_TURNS = (0, -1, 1, 1, -1, 1, 1)  # quarter turns about the parent's x axis
FLANGE = 0.107  # from the last link along its z axis
HAND_TURN = -np.pi / 4  # of the hand on the flange, about z
TCP = 0.1034  # tool centre point: from the hand's origin along its z axis
FINGER_OFFSET = 0.0584  # of the fingers' origin, likewise
FINGER_RANGE = (0.0, 0.04)  # how far each finger is from the middle
JOINT_RANGE = np.array([
    (-2.8973, 2.8973), (-1.7628, 1.7628), (-2.8973, 2.8973), (-3.0718, -0.0698),
    (-2.8973, 2.8973), (-0.0175, 3.7525), (-2.8973, 2.8973),
])  # fmt: skip
JOINT_SPEED = np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61])  # largest, rad/s

# Shares of the way to the posture of rest; two steps are enough for the motion of a control step.
_PULLS = (0.1, 0.0)
_DAMPING = 0.03  # of the least squares: a singular arm moves less instead of wildly

ACTION_NAMES = ("x", "y", "z", "yaw", "gripper")
GRIP_RANGE = (-0.01, 0.04)  # aims of a finger, metres; below 0 it presses
MOVE_STEP, TURN_STEP = 0.025, 0.1  # metres, rad a control step
_DOWN = np.array([1.0, -1.0, -1.0], np.float32)  # axes of a hand that points down at yaw 0
_LEASH = 0.3  # rad; more than this ahead of a blocked joint no aim runs, all torque is used by then


class Frame(NamedTuple):
    """A place and a rotation in the world."""

    position: Float[Array, "*B 3"]  # metres
    rotation: Float[Array, "*B 3 3"]


def turned(matrix: Float[Array, "*B 3 3"], vector: Float[Array, "*B 3"]) -> Float[Array, "*B 3"]:
    """Rotates a vector given in a frame to the world's axes."""
    return jnp.sum(matrix * vector[..., None, :], axis=-1)


def compose(a: Float[Array, "*B 3 3"], b: Float[Array, "*B 3 3"]) -> Float[Array, "*B 3 3"]:
    """The rotation `b` within the rotation `a`: the product a b."""
    return jnp.sum(a[..., :, :, None] * b[..., None, :, :], axis=-2)


def out_of(frame: Frame, point: Float[Array, "*B 3"]) -> Float[Array, "*B 3"]:
    """Maps a point given in a frame to the world."""
    return frame.position + turned(frame.rotation, point)


def into(frame: Frame, point: Float[Array, "*B 3"]) -> Float[Array, "*B 3"]:
    """Maps a point of the world into a frame."""
    away = point - frame.position
    return jnp.sum(frame.rotation * away[..., :, None], axis=-2)


def rotation(quaternion: Float[Array, "*B 4"]) -> Float[Array, "*B 3 3"]:
    """The rotation matrix of a unit quaternion."""
    w, x, y, z = jnp.moveaxis(quaternion, -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)


def about_z(angle: Float[Array, "*B"]) -> Float[Array, "*B 3 3"]:
    """A rotation about the vertical, rad."""
    return rotation(quaternion_about_z(angle))


def quaternion_about_z(angle: Float[Array, "*B"]) -> Float[Array, "*B 4"]:
    """A rotation about the vertical, as a quaternion."""
    zero = jnp.zeros_like(angle)
    return jnp.stack([jnp.cos(angle / 2), zero, zero, jnp.sin(angle / 2)], axis=-1)


def small_turn(start: Float[Array, "*B 3 3"], goal: Float[Array, "*B 3 3"]) -> Float[Array, "*B 3"]:
    """The turn from `start` to `goal`: axis times the sine of the angle, world axes.

    It is the mean of the cross products of corresponding axes, and exact to second order.
    """
    return 0.5 * jnp.sum(jnp.cross(start, goal, axis=-2), axis=-1)


def _links(q: Float[Array, "7"]) -> tuple[Float[Array, "7 3"], Float[Array, "7 3"], Frame]:
    """Origins and axes of the joints, and the last link's frame."""
    x, y, z = jnp.eye(3)
    place = jnp.zeros(3)
    origins, axes = [], []
    for offset, turn, angle in zip(LINK_OFFSETS, LINK_TURNS, q, strict=True):
        place = place + offset[0] * x + offset[1] * y + offset[2] * z
        if turn:
            y, z = turn * z, -turn * y
        c, s = jnp.cos(angle), jnp.sin(angle)
        x, y = c * x + s * y, c * y - s * x
        origins.append(place)
        axes.append(z)
    return jnp.stack(origins), jnp.stack(axes), Frame(place, jnp.stack([x, y, z], axis=1))


def _on_flange(link: Frame) -> Frame:
    x, y, z = link.rotation.T
    c, s = np.cos(HAND_TURN), np.sin(HAND_TURN)
    rotation = jnp.stack([c * x + s * y, c * y - s * x, z], axis=1)
    return Frame(link.position + FLANGE * z, rotation)


def hand(q: Float[Array, "7"]) -> Frame:
    """The hand's frame: z is its pointing direction, y the axis along which its fingers open."""
    return _on_flange(_links(q)[2])


def tcp(q: Float[Array, "7"]) -> Frame:
    """The frame of the tool centre point, between the fingertips."""
    return _ahead(hand(q), TCP)


def finger(hand: Frame, opening: Float[Array, ""], side: int) -> Frame:
    """Frame of one finger, left (`side` 1) or right (-1); its pad faces against its y axis.

    `opening` is its way from the middle, metres; the right one is turned half around the hand's z.
    """
    flip = jnp.array([side, side, 1.0])
    base = _ahead(hand, FINGER_OFFSET)
    return Frame(base.position + side * opening * hand.rotation[:, 1], hand.rotation * flip)


def _ahead(frame: Frame, distance: float) -> Frame:
    return frame._replace(position=frame.position + distance * frame.rotation[:, 2])


def jacobian(q: Float[Array, "7"]) -> tuple[Float[Array, "6 7"], Frame]:
    """The tool centre point's Jacobian, and its frame.

    Rows are its velocity (m/s) and its angular velocity (rad/s), world axes.
    """
    origins, axes, link = _links(q)
    point = _ahead(_on_flange(link), TCP)
    linear = jnp.cross(axes, point.position - origins)
    return jnp.concatenate([linear.T, axes.T]), point


def reach(q: Float[Array, "7"], goal: Frame, *, rest: Float[Array, "7"]) -> Float[Array, "7"]:
    """Joints near `q` that bring the tool centre point to `goal`, within the joints' ranges.

    Damped least squares (Nakamura and Hanafusa 1986) with a pull towards a posture of rest within
    the motions that leave the hand where it is (Liegeois 1977). A goal out of reach is approached.
    """
    low, high = JOINT_RANGE.T
    for pull in _PULLS:
        rows, point = jacobian(q)
        turn = small_turn(point.rotation, goal.rotation)
        missing = jnp.concatenate([goal.position - point.position, turn])
        wish = pull * (rest - q)
        with jax.default_matmul_precision("highest"):
            square = rows @ rows.T + _DAMPING**2 * jnp.eye(6)
            weights = jax.scipy.linalg.solve(square, missing - rows @ wish, assume_a="pos")
            q = jnp.clip(q + wish + weights @ rows, low, high)
    return q


def pointing(yaw: Float[Array, ""], tilt: float) -> Float[Array, "3 3"]:
    """The rotation of a hand that points down, or leans by `tilt`, rad."""
    turn = compose(about_z(yaw), _leaning(tilt)) if tilt else about_z(yaw)
    return turn * _DOWN


def _leaning(tilt: float) -> Float[Array, "3 3"]:
    """A turn about y by which a hand that points down points along x, too."""
    c, s = np.cos(tilt), np.sin(tilt)
    return jnp.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]], jnp.float32)


def aim(
    target: Float[Array, "8"],
    q: Float[Array, "7"],
    action: Float[Array, "5"],
    *,
    rest: Float[Array, "7"],
    dt: float,
    tilt: float = 0.0,
) -> Float[Array, "8"]:
    """The servos' next targets: seven joints (rad) and the opening of a finger (metres).

    Action (5,): the tool centre point's x, y, z (25 mm a step, world axes) and yaw about the
    vertical (0.1 rad); the hand points straight down. It is ManiSkill's pd_ee_delta_pose without
    tilts, and slower because the real arm could not follow. The last number is the gripper: -1
    closes it and presses, 1 opens it to 8 cm. Aims move from the last aims, not from the measured
    joints, so that a resting action holds the arm still. With a `tilt` (rad) the hand leans by that
    much, its fingers pointing forward along its x axis.

    `target` are the last ones, `q` the measured joints; the action is in [-1, 1]. Where the hand
    leaves it free, the arm keeps near to its posture of rest. In the `dt` seconds of a control step
    no aim moves further than its joint can.
    """
    arm, now = target[:7], tcp(target[:7])
    yaw = jnp.arctan2(now.rotation[1, 0], now.rotation[0, 0]) + TURN_STEP * action[3]
    goal = Frame(now.position + MOVE_STEP * action[:3], pointing(yaw, tilt))
    wanted = reach(arm, goal, rest=rest)
    limit = JOINT_SPEED * dt
    wanted = arm + jnp.clip(wanted - arm, -limit, limit)
    wanted = jnp.clip(wanted, q - _LEASH, q + _LEASH)
    wanted = jnp.clip(wanted, *JOINT_RANGE.T)
    low, high = GRIP_RANGE
    return jnp.concatenate([wanted, low + (high - low) * (action[-1:] + 1) / 2])
