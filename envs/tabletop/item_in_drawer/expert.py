"""A scripted expert for item in the drawer, and the ways in which its demonstrations fail.

  "success"            the drawer is pulled open by its handle, the item taken and let go above it
  "drawer only"        the drawer, then nothing
  "pulled too little"  the drawer is left nearly closed
  "closed again"       the drawer is opened and pushed shut
  "item outside"       the drawer is opened, and the item let go on the table
  "wrong order"        the item is put on the table before the drawer is opened
  "item knocked off"   the item is struck off the chest after the drawer is opened
  "stops early"        a success that breaks off at some moment

Places are in the chest's frame: its origin on the table below its middle, the drawer towards +y.
"""

import numpy as np
from gril_jax.envs.tabletop import moves
from gril_jax.envs.tabletop.hand import CLOSED, Hand
from gril_jax.envs.tabletop.moves import Pace
from gril_jax.envs.tabletop.recorded import Run
from gril_jax.envs.tabletop.script import EARLY, Script

from . import model

KINDS = ("success", "drawer only", "pulled too little", "closed again", "item outside",
         "wrong order", "item knocked off", EARLY)  # fmt: skip
_SLIDE, _ITEM = 9, 10  # positions of the joints
_BEHIND, _BELOW = 0.032, 0.006  # metres: the fingers behind the middle of the bar, and below
_TAKE = 0.004  # the tool centre point above the middle of the item
_ABOVE = 0.43  # height from which the hand goes down to the item
OPEN = 0.12  # metres: the drawer counts as open
_SHUT = 0.03
_NARROW = -0.2  # of the gripper: the item does not pass between the fingers


def _at(hand: Hand, *point: float) -> np.ndarray:
    return moves.out_of(hand.fixtures[0], point)


def _yaw(hand: Hand) -> float:
    """The hand's yaw before the chest: its fingers open along the chest's front."""
    return moves.yaw_of(hand.fixtures[0, 3:]) + np.pi / 2


def _pull(hand: Hand, rng: np.random.Generator, pace: Pace, *, by: float) -> None:
    """Hooks closed fingers behind the handle, pulls, and goes up."""
    x, speed = rng.uniform(-0.025, 0.025), rng.uniform(0.15, 0.25)
    _, bar, height = model.BAR
    bar += float(hand.qpos[_SLIDE])
    hand.grip = CLOSED
    hand.move(_at(hand, x, bar - _BEHIND, 0.3), speed=pace.speed, yaw=_yaw(hand))
    low = height - _BELOW - rng.uniform(0.0, 0.006)
    ways = ((bar - _BEHIND, low), (bar - _BEHIND + by + 0.015, low), (bar - 0.045 + by, low))
    moves.stroke(hand, [_at(hand, x, *way) for way in ways], speed=speed, yaw=_yaw(hand))
    hand.move(_at(hand, x, bar - 0.045 + by, pace.arc), speed=pace.speed)


def _shut(hand: Hand, pace: Pace) -> None:
    """Pushes the drawer shut at its handle."""
    _, bar, height = model.BAR
    away = bar + float(hand.qpos[_SLIDE]) + 0.05
    ways = ((away, pace.arc), (away, height), (bar + 0.012, height), (away, height + 0.1))
    moves.stroke(hand, [_at(hand, 0.0, *way) for way in ways], speed=0.2, yaw=_yaw(hand))


def _take(hand: Hand, pace: Pace) -> None:
    """Takes the item, and tries again if it slips."""
    for _ in range(2):
        place = moves.pose(hand, _ITEM)
        turn = moves.yaw_of(place[3:]) - _yaw(hand)
        yaw = _yaw(hand) + (turn + np.pi / 4) % (np.pi / 2) - np.pi / 4
        depth = place[2] + _TAKE
        moves.grasp(hand, place[:2], pace, depth=depth, above=_ABOVE, yaw=yaw)
        if moves.holds(hand, _ITEM, above=_ABOVE):
            return


def _put(hand: Hand, pace: Pace, *where: float) -> None:
    moves.carry(hand, _at(hand, *where), pace, yaw=_yaw(hand))
    moves.release(hand, pace)


def _follow(hand: Hand, rng: np.random.Generator, kind: str) -> None:
    """Plays the script of a kind, from its beginning to its end."""
    pace = moves.draw_pace(rng, (0.48, 0.55))
    pauses = rng.integers(0, 10, 3)
    beside = (rng.uniform(-0.12, -0.02), rng.uniform(0.46, 0.49), 0.05)
    hand.rest(int(pauses[0]))
    if kind == "wrong order":
        _take(hand, pace)
        _put(hand, pace, *beside)
    if kind == "pulled too little":
        _pull(hand, rng, pace, by=rng.uniform(0.04, 0.09))
    else:
        _pull(hand, rng, pace, by=rng.uniform(0.2, 0.23))
    hand.rest(int(pauses[1]))
    if kind == "closed again":
        _shut(hand, pace)
    elif kind == "item knocked off":
        back = moves.yaw_of(hand.fixtures[0, 3:]) - np.pi / 2 + rng.uniform(-0.2, 0.2)
        place, way = moves.pose(hand, _ITEM), (np.cos(back), np.sin(back))
        high, yaw = model.TOP + 0.02, _yaw(hand)
        moves.knock(hand, place, pace, way, height=high, reach=0.2, grip=_NARROW, yaw=yaw)
    elif kind in ("success", EARLY, "item outside"):
        _take(hand, pace)
        hand.rest(int(pauses[2]))
        inside = (rng.uniform(-0.05, 0.05), rng.uniform(0.22, 0.27), rng.uniform(0.26, 0.3))
        _put(hand, pace, *(beside if kind == "item outside" else inside))
    if kind in ("drawer only", "pulled too little"):
        hand.rest(int(rng.integers(5, 40)))


def _shows(run: Run) -> bool:
    """True if positions alone show that an episode without success is of its kind of failure."""
    item, slide = run.qpos[:, _ITEM : _ITEM + 3], run.qpos[:, _SLIDE]
    lifted = item[:, 2].max() > _ABOVE
    down = item[-1, 2] < model.FLOOR
    still = np.linalg.norm(item[-1] - item[0]) < 0.02
    moment = lambda held: int(held.argmax()) if held.any() else len(held)  # noqa: E731
    first, opened = moment(item[:, 2] > _ABOVE), moment(slide > OPEN)
    marks = {
        "drawer only": still and slide[-1] > OPEN,
        "pulled too little": still and _SHUT / 2 < slide[-1] < OPEN,
        "closed again": still and slide.max() > OPEN and slide[-1] < _SHUT,
        "item outside": lifted and down and opened < first,
        "wrong order": lifted and down and first < opened < len(slide),
        "item knocked off": not lifted and down and slide.max() > OPEN,
    }
    return bool(marks[run.kind])


SCRIPT = Script(KINDS, _follow, _shows)
