"""MJCF of the Franka Panda without meshes: published kinematics, identified inertias, few contacts.

Masses and inertias are those of Gaz et al. 2019. Three things can touch, what a scene pairs them
with: a box at each fingertip, which grips; a sphere inside it, for the tip wherever no flat contact
is needed, at a twentieth of the cost; and a capsule for the hand. The arm's weight is compensated;
servos have the gains of MuJoCo Menagerie's Panda, and the right finger mirrors the left.
"""

import numpy as np

from . import kinematics

DOFS = 9  # seven joints and two fingers
PADS = ("left_pad", "right_pad")
TIPS = ("left_tip", "right_tip")
PALM = "palm"
PAD_CENTER, PAD_HALF = (0.0, 0.00758, 0.04525), (0.00875, 0.0076, 0.00825)
# Boxes for pictures and graphs: centre and half extents in the hand's and in a finger's frame.
HAND_BOX = ((0.0, 0.0, 0.033), (0.032, 0.1, 0.033))
TIP_BOX = ((0.0, 0.0136, 0.0268), (0.011, 0.0136, 0.0268))

# mass; centre of mass; xx, yy, zz, xy, xz, yz in the link's frame (kg, m, kg m^2)
_INERTIAS = (
    (0.629769, (-0.041018, -0.00014, 0.049974),
     (0.00315, 0.00388, 0.004285, 8.29e-7, 1.5e-4, 8.23e-6)),
    (4.970684, (0.003875, 0.002081, -0.04762),
     (0.70337, 0.70661, 0.009117, -1.39e-4, 0.006772, 0.019169)),
    (0.646926, (-0.003141, -0.02872, 0.003495),
     (0.007962, 0.02811, 0.025995, -0.003925, 0.010254, 7.04e-4)),
    (3.228604, (0.027518, 0.039252, -0.066502),
     (0.037242, 0.036155, 0.01083, -0.004761, -0.011396, -0.012805)),
    (3.587895, (-0.05317, 0.104419, 0.027454),
     (0.025853, 0.019552, 0.028323, 0.007796, -0.001332, 0.008641)),
    (1.225946, (-0.011953, 0.041065, -0.038437),
     (0.035549, 0.029474, 0.008627, -0.002117, -0.004037, 2.29e-4)),
    (1.666555, (0.060149, -0.014117, -0.010517),
     (0.001964, 0.004354, 0.005433, 1.09e-4, -0.001158, 3.41e-4)),
    (0.735522, (0.010517, -0.004252, 0.061597),
     (0.012516, 0.010027, 0.004815, -4.28e-4, -0.001196, -7.41e-4)),
)  # fmt: skip
_HAND_INERTIA = (0.73, (-0.01, 0.0, 0.03), (0.001, 0.0025, 0.0017, 0.0, 0.0, 0.0))
_FINGER_INERTIA = (0.015, (0.0, 0.0, 0.0), (2.375e-6, 2.375e-6, 7.5e-7, 0.0, 0.0, 0.0))

_KP = (1000, 1000, 750, 750, 300, 300, 300)
_KV = (20, 20, 4, 4, 2, 2, 2)
_TORQUE = (87, 87, 87, 87, 12, 12, 12)  # N m, the maker's limits
_JOINT_DAMPING = (40, 40, 40, 40, 2, 2, 2)
_ARMATURE = 0.1
_QUARTERS = {0: "1 0 0 0", 1: "1 1 0 0", -1: "1 -1 0 0"}

# The maker's hull: link, radius, length of the cylinder, centre, axis.
_HULL = (
    (0, 0.06, 0.03, (-0.075, 0, 0.06), "x"), (1, 0.06, 0.283, (0, 0, -0.1915), "z"),
    (2, 0.06, 0.12, (0, 0, 0), "z"), (3, 0.06, 0.15, (0, 0, -0.145), "z"),
    (4, 0.06, 0.12, (0, 0, 0), "z"), (5, 0.06, 0.1, (0, 0, -0.26), "z"),
    (5, 0.025, 0.14, (0, 0.08, -0.13), "z"), (6, 0.05, 0.08, (0, 0, -0.03), "z"),
    (7, 0.04, 0.14, (0, 0, 0.01), "z"),
)  # fmt: skip
_HULL_TURNS = {"x": "0.70710678 0 0.70710678 0", "y": "0.70710678 0.70710678 0 0", "z": "1 0 0 0"}


def words(numbers) -> str:
    """Numbers as MJCF has them."""
    return " ".join(f"{x:.9g}" for x in numbers)


def _inertial(values) -> str:
    mass, center, tensor = values
    return f'<inertial mass="{mass}" pos="{words(center)}" fullinertia="{words(tensor)}"/>'


def _capsule(name: str, radius: float, length: float, center, axis: str) -> str:
    return (
        f'<geom {name} type="capsule" size="{radius} {length / 2}" pos="{words(center)}" '
        f'quat="{_HULL_TURNS[axis]}"/>'
    )


def _finger(side: int) -> str:
    """The left finger (side 0), or the right one, turned half around."""
    turn = ("1 0 0 0", "0 0 0 1")[side]
    name = ("left_finger", "right_finger")[side]
    low, high = kinematics.FINGER_RANGE
    return (
        f'<body name="{name}" pos="0 0 {kinematics.FINGER_OFFSET}" quat="{turn}" gravcomp="1">'
        f"{_inertial(_FINGER_INERTIA)}"
        f'<joint name="{name}" type="slide" axis="0 1 0" range="{low} {high}" damping="10"'
        f' armature="{_ARMATURE}"/>'
        f'<geom name="{PADS[side]}" type="box" pos="{words(PAD_CENTER)}"'
        f' size="{words(PAD_HALF)}"/>'
        # its lowest point is the pad's
        f'<geom name="{TIPS[side]}" type="sphere" pos="0 0.00758 0.0455" size="0.008"/></body>'
    )


def body() -> str:
    """The arm's bodies, its base at the origin; joints are joint1 to joint7 and the fingers."""
    palm = _capsule(f'name="{PALM}"', 0.04, 0.12, (0, 0, 0.03), "y")
    hand = (
        f'<body name="hand" pos="0 0 {kinematics.FLANGE}" gravcomp="1"'
        f' quat="{np.cos(kinematics.HAND_TURN / 2)} 0 0 {np.sin(kinematics.HAND_TURN / 2)}">'
        f"{_inertial(_HAND_INERTIA)}{palm}"
        f"{_finger(0)}{_finger(1)}</body>"
    )
    hulls = [
        "".join(_capsule("", *shape) for of, *shape in _HULL if of == link) for link in range(8)
    ]
    inner = hand
    for link in range(7, 0, -1):
        low, high = kinematics.JOINT_RANGE[link - 1]
        offset, turn = kinematics.LINK_OFFSETS[link - 1], kinematics.LINK_TURNS[link - 1]
        inner = (
            f'<body name="link{link}" pos="{words(offset)}" quat="{_QUARTERS[turn]}" gravcomp="1">'
            f"{_inertial(_INERTIAS[link])}"
            f'<joint name="joint{link}" axis="0 0 1" range="{low} {high}"'
            f' damping="{_JOINT_DAMPING[link - 1]}" armature="{_ARMATURE}"/>'
            f"{hulls[link]}{inner}</body>"
        )
    return f'<body name="link0">{_inertial(_INERTIAS[0])}{hulls[0]}{inner}</body>'


def _servo(joint: str, kp: int, kv: int, torque: int, aims) -> str:
    limits = f'ctrlrange="{aims[0]} {aims[1]}" forcerange="{-torque} {torque}"'
    return f'<position joint="{joint}" kp="{kp}" kv="{kv}" {limits}/>'


_NAMES = (f"joint{link}" for link in range(1, 8))
_GAINS = zip(_NAMES, _KP, _KV, _TORQUE, kinematics.JOINT_RANGE, strict=True)
ACTUATORS = "".join(_servo(*gains) for gains in _GAINS)
ACTUATORS += _servo("left_finger", 350, 10, 200, kinematics.GRIP_RANGE)
# The right finger mirrors the left one.
EQUALITY = (
    '<joint joint1="left_finger" joint2="right_finger" solref="0.005 1" solimp="0.95 0.99 0.001"/>'
)
