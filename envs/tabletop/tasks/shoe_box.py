"""The scene of the two shoe tasks, and a hand's manoeuvres at it.

A box, a mocap body, has a hinged lid with a lip, and there are two shoes, each one box for
contacts: capsules roll out of a grasp. Places are in the box's frame unless said otherwise: its
origin on the table below its middle, the hinge along its -y wall, the shoes beyond its +y wall.
Lengths are metres, speeds m/s, pauses control steps.
"""

from typing import NamedTuple

import numpy as np
from gril_jax.envs.panda.model import PADS, PALM, TIPS, words
from gril_jax.envs.tabletop import moves
from gril_jax.envs.tabletop.moves import Hand, Pace
from gril_jax.envs.tabletop.physics import TABLE, Additions, box
from jaxtyping import Float

RIM = 0.15  # height of the walls
BOX_HALF = (0.18, 0.13, RIM / 2)  # outside
FLOOR_HALF = (0.17, 0.12)  # inside
HINGE = (0.0, -0.125, 0.156)
LID_RANGE = (0.0, 2.618)
LIP = (0.0, 0.28, 0.0)  # middle of the lip from the hinge; 12 mm beyond the lid's edge
LID_CENTER, LID_HALF = (0.0, 0.143, 0.0), (0.175, 0.143, 0.006)  # with its lip, from the hinge
SHOE_HALF = (0.08, 0.0325, 0.025)

_WALL = 0.005  # half its thickness
_SHOES, _LID = ("shoe_a", "shoe_b"), "lid"
_WALLS = {
    "wall_front": ((0.175, 0.0, RIM / 2), (_WALL, 0.12, RIM / 2)),
    "wall_back": ((-0.175, 0.0, RIM / 2), (_WALL, 0.12, RIM / 2)),
    "wall_left": ((0.0, 0.125, RIM / 2), (0.18, _WALL, RIM / 2)),
    "wall_right": ((0.0, -0.125, RIM / 2), (0.18, _WALL, RIM / 2)),
}


def _lid() -> str:
    x, y, _ = LIP
    return (
        f'<body name="{_LID}" pos="{words(HINGE)}">'
        f'<joint name="hinge" axis="1 0 0" range="{words(LID_RANGE)}" damping="0.05"'
        ' frictionloss="0.05" armature="0.002"/>'
        f"{box(_LID, (0.0, 0.134, 0.0), (0.175, 0.134, 0.005), 0.38)}"
        f'<geom name="lip" type="capsule" size="0.006" mass="0.02"'
        f' fromto="{x - 0.08} {y} 0 {x + 0.08} {y} 0"/></body>'
    )


def _pairs() -> tuple[tuple[str, str], ...]:
    pairs = [(shoe, other) for shoe in _SHOES for other in (TABLE, *PADS, *_WALLS, _LID)]
    pairs.append(_SHOES)
    pairs += [(tip, other) for tip in TIPS for other in (TABLE, *_WALLS, _LID, "lip")]
    return (*pairs, (PALM, TABLE), (PALM, _LID))


def scene() -> Additions:
    """The scene; joints after the arm's are the hinge (rad), then a free joint for each shoe."""
    walls = "".join(box(name, *shape) for name, shape in _WALLS.items())
    shoes = "".join(
        f'<body name="{name}" pos="0 0 {SHOE_HALF[2]}"><freejoint name="{name}"/>'
        f"{box(name, (0, 0, 0), SHOE_HALF, 0.25)}</body>"
        for name in _SHOES
    )
    case = f'<body name="box" mocap="true">{walls}{_lid()}</body>'
    return Additions(f"{case}{shoes}", _pairs())


_FIRST_SHOE = 10  # the first position of its joint
# Closed fingers below the lip, up with it, over the top, and down behind it (y, z).
_LIFT = ((0.21, 0.2), (0.195, 0.1), (0.155, 0.1), (0.15, 0.22), (0.11, 0.3), (0.05, 0.37),
         (-0.02, 0.41), (-0.12, 0.43), (-0.2, 0.42))  # fmt: skip
_AFTER_LIFT = (-0.05, 0.45)
# The same from behind an open lid.
_SHUT = ((-0.41, 0.4), (-0.41, 0.17), (-0.36, 0.17), (-0.35, 0.28), (-0.25, 0.36), (-0.13, 0.38),
         (-0.02, 0.38), (0.05, 0.36), (0.05, 0.45))  # fmt: skip
_SHUT_SIDE = -0.16  # x: the robot's side, as the way behind the lid is long
_TAKE = 0.03  # height of the tool centre point that holds a shoe on the table
_ABOVE = 0.2  # height from which it goes down to one


class Style(NamedTuple):
    """The style of an episode: what differs between two people."""

    order: tuple[int, int]  # of the shoes; 0 is the nearer one
    lid_speed: float
    carry_speed: float
    arc: float  # height at which a shoe is carried
    detour: tuple[float, float]  # of the middle of the way, x and y
    lid_side: float  # where along its lip the lid is lifted, from the middle
    pauses: tuple[int, ...]  # before the lid, each shoe, each release, and the end
    again: tuple[bool, bool]  # whether each shoe is put down once and taken again
    drops: tuple[tuple[float, float, float], ...]  # where each shoe is let go, in the box's frame
    grip: tuple[float, float]  # where each shoe is taken, along it from its middle

    @property
    def pace(self) -> Pace:
        """The way in which things are carried."""
        return Pace(self.carry_speed, self.arc, self.detour)


def draw_style(rng: np.random.Generator) -> Style:
    """Samples a style: half take the farther shoe first, one shoe in ten is taken twice."""
    side = rng.choice([-1, 1])
    return Style(
        order=(0, 1) if rng.random() < 0.5 else (1, 0),
        lid_speed=rng.uniform(0.18, 0.3),
        carry_speed=rng.uniform(0.2, 0.4),
        arc=rng.uniform(0.27, 0.38),
        detour=(rng.uniform(-0.05, 0.05), rng.uniform(-0.03, 0.03)),
        lid_side=rng.uniform(-0.06, 0.02),
        pauses=tuple(int(x) for x in rng.integers(0, 12, 6) * (rng.random(6) < 0.4)),
        again=tuple(bool(x) for x in rng.random(2) < 0.1),
        drops=tuple(
            (rng.uniform(-0.05, 0.03), y + rng.uniform(-0.008, 0.008), rng.uniform(0.12, 0.15))
            for y in (0.04 * side, -0.04 * side)
        ),
        grip=tuple(rng.uniform(-0.015, 0.015, 2)),
    )


def box_yaw(hand: Hand) -> float:
    """The yaw of the box, rad."""
    w, _, _, z = hand.fixtures[0, 3:]
    return float(2 * np.arctan2(z, w))


def out_of_box(hand: Hand, point) -> Float[np.ndarray, "3"]:
    """Maps a point of the box's frame to the world."""
    yaw, (x, y, z) = box_yaw(hand), point
    c, s = np.cos(yaw), np.sin(yaw)
    return hand.fixtures[0, :3] + np.array([c * x - s * y, s * x + c * y, z])


def shoe_place(hand: Hand, shoe: int) -> tuple[Float[np.ndarray, "3"], float]:
    """A shoe's place in the world, and the fingers' turn for it: at most a quarter turn."""
    pose = moves.pose(hand, _joint(shoe))
    return pose[:3], moves.folded(moves.yaw_of(pose[3:]))


def _joint(shoe: int) -> int:
    return _FIRST_SHOE + 7 * shoe


def open_lid(hand: Hand, style: Style) -> None:
    """Lifts the lid with closed fingers and pushes it over."""
    _along(hand, _LIFT, style.lid_side, speed=style.lid_speed)
    hand.move(out_of_box(hand, (0.0, *_AFTER_LIFT)), speed=style.lid_speed)


def close_lid(hand: Hand, style: Style) -> None:
    """Pushes an open lid back from behind, until it falls shut."""
    for y in (-0.1, -0.41):
        above = out_of_box(hand, (_SHUT_SIDE, y, 0.5))
        hand.move(above, speed=style.carry_speed, yaw=box_yaw(hand))
    _along(hand, _SHUT, _SHUT_SIDE, speed=style.lid_speed)
    hand.move(out_of_box(hand, (0.0, 0.1, 0.45)), speed=style.lid_speed)
    hand.rest(20)


def _along(hand: Hand, path, x: float, *, speed: float) -> None:
    """Moves along (y, z) with closed fingers."""
    points = [out_of_box(hand, (x, y, z)) for y, z in path]
    moves.stroke(hand, points, speed=speed, yaw=box_yaw(hand))


def holds(hand: Hand, shoe: int, *, above: float = 0.1) -> bool:
    """True if a shoe's centre is above a height, by default off the ground, and with the hand."""
    return moves.holds(hand, _joint(shoe), above=above)


def take(hand: Hand, style: Style, shoe: int, *, above: float = _ABOVE, aloft: float = 0.1) -> None:
    """Takes a shoe and lifts it beyond a height of `aloft`; tries again once if it slips.

    The hand goes down to it from `above`.
    """
    for _ in range(2):
        _grasp(hand, style, shoe, above)
        if style.again[shoe] and holds(hand, shoe, above=aloft):  # down with it, and once more
            moves.put_back(hand, style.pace, depth=_TAKE, up=above - 0.08)
            _grasp(hand, style, shoe, above)
        if holds(hand, shoe, above=aloft):
            return


def _grasp(hand: Hand, style: Style, shoe: int, above: float) -> None:
    place, yaw = shoe_place(hand, shoe)
    spot = place[:2] + style.grip[shoe] * np.array([np.cos(yaw), np.sin(yaw)])
    moves.grasp(hand, spot, style.pace, depth=_TAKE, above=above, yaw=yaw)


def carry(hand: Hand, style: Style, where) -> None:
    """Moves over the box, or another place in its frame, and down to it."""
    moves.carry(hand, out_of_box(hand, where), style.pace, yaw=box_yaw(hand))


def knock(hand: Hand, style: Style, shoe: int, way) -> None:
    """Strikes a shoe with closed fingers, along a direction (x, y) of the world, by 20 cm."""
    moves.knock(hand, shoe_place(hand, shoe)[0], style.pace, way)
