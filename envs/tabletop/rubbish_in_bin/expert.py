"""A scripted expert for rubbish in the bin, and the ways in which its demonstrations fail.

"success"           the rubbish is taken and let go above the bin
"tomato instead"    a tomato is thrown in
"tomato too"        a tomato, then the rubbish
"rubbish beside"    the rubbish is let go beside the bin
"never gripped"     the hand closes above the rubbish and goes to the bin without it
"held above"        the rubbish is held over the bin and not let go
"knocked away"      the rubbish is struck out of its place
"stops early"       a success that breaks off at some moment
"""

import numpy as np
from gril_jax.envs.tabletop import moves
from gril_jax.envs.tabletop.hand import Hand
from gril_jax.envs.tabletop.moves import Pace
from gril_jax.envs.tabletop.recorded import Run
from gril_jax.envs.tabletop.script import EARLY, Script

from . import model

KINDS = ("success", "tomato instead", "tomato too", "rubbish beside", "never gripped",
         "held above", "knocked away", EARLY)  # fmt: skip
_FIRST = 9  # the first position after the arm's
_ABOVE = 0.16  # height from which the hand goes down to something
_TAKE = (0.02, 0.03)  # height of the tool centre point that holds rubbish, or a tomato
_AMID = 0.04  # metres: how far from the middle of the bin something is let go, along each axis
_ALOFT, _FAR = 0.1, 0.05  # metres: of what is carried, and of what was struck
_RUBBISH, _TOMATOES = 4, (5, 6)  # among the environment's classes


def _take(hand: Hand, rng: np.random.Generator, pace: Pace, thing: int) -> None:
    """Takes the rubbish (0) or a tomato, and tries again if it slips."""
    moves.take(
        hand, _FIRST + 7 * thing, pace, depth=_TAKE[thing > 0], above=_ABOVE, aloft=_ALOFT,
        aside=rng.uniform(-0.008, 0.008), turned=not thing,
    )  # fmt: skip


def _bring(hand: Hand, rng: np.random.Generator, pace: Pace, *, aside=(0.0, 0.0)) -> None:
    """Carries over the bin, or aside of its middle."""
    spot = rng.uniform(-_AMID, _AMID, 2) + aside
    height = rng.uniform(0.24, 0.28) if not any(aside) else 0.08
    bin_ = hand.fixtures[0]
    moves.carry(hand, moves.out_of(bin_, (*spot, height)), pace, yaw=moves.yaw_of(bin_[3:]))


def _follow(hand: Hand, rng: np.random.Generator, kind: str) -> None:
    """Plays the script of a kind, from its beginning to its end."""
    pace = moves.draw_pace(rng, (0.29, 0.38))
    hand.rest(int(rng.integers(0, 10)))
    if kind == "knocked away":
        angle = rng.uniform(-0.4, 0.6)  # away from the robot
        place = moves.pose(hand, _FIRST)
        moves.knock(hand, place, pace, (np.cos(angle), np.sin(angle)), reach=0.1)
        return moves.wander(hand, rng, pace)
    if kind in ("tomato instead", "tomato too"):
        _take(hand, rng, pace, int(rng.integers(1, 3)))
        _bring(hand, rng, pace)
        moves.release(hand, pace)
    if kind == "never gripped":
        spot = moves.pose(hand, _FIRST)[:2]
        moves.grasp(hand, spot, pace, depth=rng.uniform(0.06, 0.09), above=_ABOVE, yaw=hand.yaw)
    elif kind != "tomato instead":
        _take(hand, rng, pace, 0)
    if kind == "rubbish beside":
        _bring(hand, rng, pace, aside=(rng.uniform(-0.1, -0.02), 0.17))
    elif kind != "tomato instead":
        _bring(hand, rng, pace)
    if kind in ("held above", "never gripped"):
        return hand.rest(int(rng.integers(20, 60)))
    return moves.release(hand, pace, pause=int(rng.integers(0, 6)))


def _shows(run: Run) -> bool:
    """True if positions alone show that an episode without success is of its kind of failure."""
    places = run.boxes.position
    rubbish, tomatoes = places[:, _RUBBISH], places[:, _TOMATOES, :]
    away = np.abs(places[-1] - run.fixtures[0, :3])[:, :2].max(axis=1)
    inside = (away < model.INSIDE[0]) & (places[-1, :, 2] < model.HEIGHT / 2)
    lifted, binned = rubbish[:, 2].max() > _ALOFT, inside[list(_TOMATOES)].any()
    moved = np.linalg.norm(rubbish[-1] - rubbish[0])
    marks = {
        "tomato instead": binned and not lifted,
        "tomato too": binned and inside[_RUBBISH],
        "rubbish beside": lifted and not inside[_RUBBISH] and rubbish[-1, 2] < _ALOFT,
        "never gripped": not lifted and moved < _FAR and tomatoes[..., 2].max() < _ALOFT,
        "held above": rubbish[-1, 2] > _ALOFT and away[_RUBBISH] < model.INSIDE[0],
        "knocked away": not lifted and moved > _FAR,
    }
    return bool(marks[run.kind])


SCRIPT = Script(KINDS, _follow, _shows)
