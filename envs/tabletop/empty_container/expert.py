"""A scripted expert for empty container, and the ways in which its demonstrations fail.

"success"            all three blocks, the one nearest to the bin first
"two blocks"         two of them, then nothing
"one block"          one of them, then nothing
"wrong bin"          one of them is put into the other bin
"block beside"       one of them is let go between tray and bin
"back in the tray"   one of them is lifted and let go over the tray
"stops early"        a success that breaks off at some moment
"""

import numpy as np
from gril_jax.envs.tabletop import moves
from gril_jax.envs.tabletop.hand import Hand
from gril_jax.envs.tabletop.moves import Pace
from gril_jax.envs.tabletop.recorded import Run
from gril_jax.envs.tabletop.script import EARLY, Script

from . import model

KINDS = ("success", "two blocks", "one block", "wrong bin", "block beside", "back in the tray",
         EARLY)  # fmt: skip
_FIRST = 9  # the first position after the arm's
_TRAY, _BIN, _OTHER = range(3)  # of the fixtures
_ABOVE, _ALOFT = 0.15, 0.1  # metres: the hand over a block; a block that is carried
_DEPTH = 0.018
_ALONG = (-0.06, 0.0, 0.06)  # the bin's x at which blocks are let go, across it: any at any


def _take(hand: Hand, rng: np.random.Generator, pace: Pace, block: int) -> None:
    """Takes a block, and tries again if it slips."""
    aside, joint = rng.uniform(-0.008, 0.008), _FIRST + 7 * block
    moves.take(hand, joint, pace, depth=_DEPTH, above=_ABOVE, aloft=_ALOFT, aside=aside)


def _put(hand: Hand, pace: Pace, to: int, *where: float) -> None:
    """Lets go at a place in the frame of a fixture, the block across it."""
    base = hand.fixtures[to]
    yaw = moves.yaw_of(base[3:]) + np.pi / 2
    moves.carry(hand, moves.out_of(base, where), pace, yaw=yaw)
    moves.release(hand, pace)


def _follow(hand: Hand, rng: np.random.Generator, kind: str) -> None:
    """Plays the script of a kind, from its beginning to its end."""
    pace = moves.draw_pace(rng, (0.19, 0.28))
    astray = kind in ("wrong bin", "block beside", "back in the tray")
    missed = int(rng.integers(0, 3)) if astray else None
    along = rng.permutation(_ALONG)
    count = {"two blocks": 2, "one block": 1}.get(kind, 3)
    for block in range(count):
        hand.rest(int(rng.integers(0, 8)) * int(rng.random() < 0.4))
        _take(hand, rng, pace, block)
        height = rng.uniform(0.065, 0.08)
        spot = (along[block] + rng.uniform(-0.008, 0.008), rng.uniform(-0.008, 0.008), height)
        if block != missed:
            _put(hand, pace, _BIN, *spot)
        elif kind == "wrong bin":
            _put(hand, pace, _OTHER, *spot)
        elif kind == "block beside":
            _put(hand, pace, _BIN, rng.uniform(0.15, 0.2), rng.uniform(-0.05, 0.05), 0.05)
        else:
            _put(hand, pace, _TRAY, *rng.uniform(-0.05, 0.05, 2), 0.1)
    if count < 3:
        moves.wander(hand, rng, pace)


def _within(run: Run, fixture: int, half: tuple[float, float]) -> np.ndarray:
    """Which blocks end within the walls of a fixture."""
    x, y, z = run.fixtures[fixture, :3]
    turn = moves.yaw_of(run.fixtures[fixture, 3:])
    c, s = np.cos(turn), np.sin(turn)
    away = run.boxes.position[-1, -3:] - [x, y, z]
    local = np.stack([c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]], axis=1)
    return (np.abs(local) < half).all(axis=1) & (away[:, 2] < _ALOFT)


def _shows(run: Run) -> bool:
    """True if positions alone show that an episode without success is of its kind of failure."""
    lifted = run.boxes.position[:, -3:, 2].max(axis=0) > _ALOFT
    binned, other = _within(run, _BIN, model.BIN), _within(run, _OTHER, model.BIN)
    tray = _within(run, _TRAY, model.TRAY)
    marks = {
        "two blocks": binned.sum() == 2 and lifted.sum() == 2,
        "one block": binned.sum() == 1 and lifted.sum() == 1,
        "wrong bin": binned.sum() == 2 and other.sum() == 1,
        "block beside": binned.sum() == 2 and not (other | tray).any(),
        "back in the tray": lifted.all() and binned.sum() == 2 and (tray & lifted).any(),
    }
    return bool(marks[run.kind])


SCRIPT = Script(KINDS, _follow, _shows)
