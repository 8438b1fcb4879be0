"""The scene of the two shoe tasks: a box with a hinged lid that has a lip, and two shoes.

The box is a mocap body, so that each episode can have it elsewhere. Its frame has the origin on the
table below the box's middle; the hinge is along its -y wall, and the lid opens from 0 to 2.618 rad.
A shoe is one box for contacts: capsules roll out of a grasp. Lengths are metres.
"""

from gril_jax.envs.panda.model import PADS, PALM, TIPS, words
from gril_jax.envs.tabletop.physics import TABLE, Additions

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


def _box(name: str, center, half, mass: float = 0.0) -> str:
    place = f'pos="{words(center)}" size="{words(half)}"'
    return f'<geom name="{name}" type="box" {place} mass="{mass}"/>'


def _lid() -> str:
    x, y, _ = LIP
    return (
        f'<body name="{_LID}" pos="{words(HINGE)}">'
        f'<joint name="hinge" axis="1 0 0" range="{words(LID_RANGE)}" damping="0.05"'
        ' frictionloss="0.05" armature="0.002"/>'
        f"{_box(_LID, (0.0, 0.134, 0.0), (0.175, 0.134, 0.005), 0.38)}"
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
    walls = "".join(_box(name, *shape) for name, shape in _WALLS.items())
    shoes = "".join(
        f'<body name="{name}" pos="0 0 {SHOE_HALF[2]}"><freejoint name="{name}"/>'
        f"{_box(name, (0, 0, 0), SHOE_HALF, 0.25)}</body>"
        for name in _SHOES
    )
    box = f'<body name="box" mocap="true">{walls}{_lid()}</body>'
    return Additions(f"{box}{shoes}", _pairs())
