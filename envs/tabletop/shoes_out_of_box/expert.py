"""A scripted expert for shoes out of the box, and the ways in which its demonstrations fail.

  "success"            lid, then both shoes in either order
  "lid only"           the lid, then nothing
  "one shoe"           the lid and one shoe
  "shoe back in"       the other shoe is lifted, and let go in the box again
  "shoe held"          the other shoe is held above the table and not let go
  "lid closed again"   the lid is pushed shut when one shoe is out, or none
  "stops early"        a success that breaks off at some moment

Places are in the box's frame, as in `shoes_in_box.moves`.
"""

import numpy as np
from gril_jax.envs.panda.model import DOFS
from gril_jax.envs.tabletop.hand import Hand
from gril_jax.envs.tabletop.moves import release, wander
from gril_jax.envs.tabletop.recorded import Run
from gril_jax.envs.tabletop.script import EARLY, Script
from gril_jax.envs.tabletop.shoes_in_box import moves
from gril_jax.envs.tabletop.shoes_in_box.moves import Style, draw_style

KINDS = ("success", "lid only", "one shoe", "shoe back in", "shoe held", "lid closed again",
         EARLY)  # fmt: skip
SLOTS = ((-0.013, 0.27), (-0.013, 0.40))  # where each shoe is put, x and y
_ABOVE, _ALOFT = 0.3, 0.2  # metres: the hand over a shoe in the box; a shoe out of it
_DOWN = 0.036  # height of the tool centre point that puts a shoe on the table
_SHUT, _OPENED = 0.1, 1.571  # rad, of the lid


def _style(rng: np.random.Generator) -> Style:
    """A style whose arcs clear the rim, and whose shoes are put down in their slots."""
    drawn = draw_style(rng)
    drops = tuple((*(slot + rng.uniform(-0.015, 0.015, 2)), _DOWN) for slot in SLOTS)
    grip = tuple(rng.uniform(-0.01, 0.01, 2))
    return drawn._replace(arc=rng.uniform(0.32, 0.38), drops=drops, grip=grip)


def _lift(hand: Hand, style: Style, number: int) -> None:
    hand.rest(style.pauses[1 + number])
    moves.take(hand, style, style.order[number], above=_ABOVE, aloft=_ALOFT)


def _put(hand: Hand, style: Style, number: int) -> None:
    """Takes the shoe that is number `number` in order, and puts it down in its slot."""
    _lift(hand, style, number)
    moves.carry(hand, style, style.drops[style.order[number]])
    release(hand, style.pace, pause=style.pauses[3 + number])


def _follow(hand: Hand, rng: np.random.Generator, kind: str) -> None:
    """Plays the script of a kind, from its beginning to its end."""
    style = _style(rng)
    hand.rest(style.pauses[0])
    moves.open_lid(hand, style)
    if kind == "lid closed again":
        if rng.random() < 0.5:
            _put(hand, style, 0)
        return moves.close_lid(hand, style)
    if kind != "lid only":
        _put(hand, style, 0)
    if kind in ("success", EARLY):
        _put(hand, style, 1)
    elif kind == "shoe back in":
        _lift(hand, style, 1)
        side = -0.083 if style.order[1] == 0 else 0.083
        moves.carry(hand, style, (side, rng.uniform(-0.02, 0.02), rng.uniform(0.06, 0.1)))
        release(hand, style.pace)
    elif kind == "shoe held":
        _lift(hand, style, 1)
        x, y = SLOTS[style.order[1]]
        moves.carry(hand, style, (x, y, rng.uniform(0.15, 0.25)))
        hand.rest(int(rng.integers(10, 40)))
    else:
        wander(hand, rng, style.pace)
    return None


def _shows(run: Run) -> bool:
    """True if positions alone show that an episode without success is of its kind of failure."""
    lid, out, heights = run.qpos[:, DOFS], run.stages[-1, 1:], run.boxes.position[:, -2:, 2]
    number, lifted = int(out.sum()), heights.max(axis=0) > _ALOFT
    opened, down = (lid > _OPENED).any(), heights[-1] < _ALOFT / 2
    marks = {
        "lid only": opened and not lifted.any() and lid[-1] > _OPENED,
        "one shoe": number == 1 and not lifted[~out].any(),
        "shoe back in": number == 1 and lifted.all() and down.all(),
        "shoe held": number == 1 and lifted.all() and not down[~out].any(),
        "lid closed again": opened and lid[-1] < _SHUT,
    }
    return bool(marks[run.kind])


SCRIPT = Script(KINDS, _follow, _shows)
