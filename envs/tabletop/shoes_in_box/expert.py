"""A scripted expert for shoes in the box, and the ways in which its demonstrations fail.

"success"            lid, then both shoes in either order
"lid only"           the lid, then nothing
"one shoe"           the lid and one shoe
"shoe outside"       the other shoe is let go beside the box
"lid closed again"   the lid is pushed shut when one shoe is in, or none
"stops early"        a success that breaks off at some moment
"wrong order"        a shoe is put on the closed lid before that is opened
"shoe knocked away"  a shoe is struck out of reach, the other put in
"""

import numpy as np
from gril_jax.envs.panda import model as panda_model
from gril_jax.envs.tabletop.hand import Hand
from gril_jax.envs.tabletop.moves import release, wander
from gril_jax.envs.tabletop.recorded import Run
from gril_jax.envs.tabletop.script import Script
from jaxtyping import Bool, Float

from . import model, moves
from .moves import Style, draw_style

KINDS = ("success", "lid only", "one shoe", "shoe outside", "lid closed again", "stops early",
         "wrong order", "shoe knocked away")  # fmt: skip
_SHUT, _OPENED = 0.1, 1.571  # rad, of the lid
_OFF_TABLE = 0.1  # metres: the centre of a carried shoe
_ON_LID = (0.17, 0.25)  # metres: the centre of a shoe that lies on the closed lid
_FAR = 0.1  # metres


def _put(hand: Hand, style: Style, number: int, *, where=None) -> None:
    """Takes the shoe that is number `number` in order and releases it in the box, or elsewhere."""
    hand.rest(style.pauses[1 + number])
    moves.take(hand, style, style.order[number])
    moves.carry(hand, style, style.drops[number] if where is None else where)
    release(hand, style.pace, pause=style.pauses[3 + number])


def _follow(hand: Hand, rng: np.random.Generator, kind: str) -> None:
    """Plays the script of a kind, from its beginning to its end."""
    style = draw_style(rng)
    hand.rest(style.pauses[0])
    if kind == "wrong order":
        _put(hand, style, 0, where=(*style.drops[0][:2], 0.2))
    moves.open_lid(hand, style)
    if kind == "shoe knocked away":
        angle = moves.box_yaw(hand) + rng.uniform(-0.4, 0.4)  # away from the robot
        moves.knock(hand, style, style.order[1], (np.cos(angle), np.sin(angle)))
    if kind == "lid closed again":
        if rng.random() < 0.5:
            _put(hand, style, 0)
        moves.close_lid(hand, style)
    elif kind not in ("lid only", "wrong order"):
        _put(hand, style, 0)
    if kind in ("success", "stops early", "wrong order"):
        _put(hand, style, 1)
    if kind == "shoe outside":
        _put(hand, style, 1, where=(rng.uniform(-0.12, 0.12), rng.uniform(0.2, 0.26), 0.1))
    if kind in ("lid only", "one shoe", "shoe outside"):
        wander(hand, rng, style.pace)


def shows(
    kind: str,
    shoes: Float[np.ndarray, "T 2 3"],
    lid: Float[np.ndarray, "T"],
    inside: Bool[np.ndarray, "2"],
    box: Float[np.ndarray, "2"],
) -> bool:
    """True if positions alone show that an episode without success is of this kind of failure.

    Shoes and box are given by their centres in metres, the lid by its angle in rad.
    """
    number, opened = int(inside.sum()), bool((lid > _OPENED).any())
    lifted = shoes[:, :, 2].max(axis=0) > _OFF_TABLE
    away = np.linalg.norm(shoes[-1, :, :2] - shoes[0, :, :2], axis=1)
    down = (shoes[-1, ~inside, 2] < _OFF_TABLE).all()
    left = number == 1 and not lifted[~inside].any()  # the other shoe was not taken
    over = np.linalg.norm(shoes[:, :, :2] - box, axis=2) < model.BOX_HALF[0]
    on_lid = over & (shoes[:, :, 2] > _ON_LID[0]) & (shoes[:, :, 2] < _ON_LID[1])
    marks = {
        "lid only": lid[-1] > _OPENED and number == 0 and not lifted.any(),
        "one shoe": opened and left,
        "shoe outside": opened and number == 1 and lifted.all() and down,
        "lid closed again": opened and lid[-1] < _SHUT,
        "stops early": True,
        "wrong order": (on_lid & (lid < _SHUT)[:, None]).any(),
        "shoe knocked away": left and (away[~inside] > _FAR).all(),
    }
    return bool(marks[kind])


def _shows(run: Run) -> bool:
    shoes = run.boxes.position[:, -2:]
    lid, box = run.qpos[:, panda_model.DOFS], run.fixtures[0, :2]
    return shows(run.kind, shoes, lid, run.stages[-1, 1:], box)


SCRIPT = Script(KINDS, _follow, _shows)
play, perform, as_meant = SCRIPT.play, SCRIPT.perform, SCRIPT.as_meant
