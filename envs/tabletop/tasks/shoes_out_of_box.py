"""RLBench's take_shoes_out_of_box: open the lid, then take both shoes out.

Things: box, lid, shoe A (the robot's side), shoe B, which lie in it end to end; a start moves each
by what the box leaves it.
Stages: the lid open (as for shoes in the box), shoe A out, shoe B out: on the table at the robot's
left of the box, and released. Success: both shoes are out, slower than 0.05 m/s, in 5 frames in a
row; the lid may be at any angle then.
"""

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.panda.kinematics import Frame, about_z, out_of
from gril_jax.envs.panda.model import DOFS
from gril_jax.envs.stages import Stages
from gril_jax.envs.tabletop import HOME, placing
from gril_jax.envs.tabletop.boxes import Boxes
from gril_jax.envs.tabletop.demonstrations import Entry
from gril_jax.envs.tabletop.moves import Hand, release, wander
from gril_jax.envs.tabletop.placing import Area, Spot
from gril_jax.envs.tabletop.recorded import EARLY, Run, Script
from gril_jax.envs.tabletop.reward import StageProgress
from gril_jax.envs.tabletop.start import Start, free_joint, group
from gril_jax.envs.tabletop.task import Task, View
from jaxtyping import PRNGKeyArray

from . import shoe_box
from .shoe_box import Style, draw_style
from .shoes_in_box import IN_PICTURES, of_shoes, shoe_boxes, with_lid

KINDS = (
    "success",  # lid, then both shoes in either order
    "lid only",  # the lid, then nothing
    "one shoe",  # the lid and one shoe
    "shoe back in",  # the other shoe is lifted, and let go in the box again
    "shoe held",  # the other shoe is held above the table and not let go
    "lid closed again",  # the lid is pushed shut when one shoe is out, or none
    EARLY,
)
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
    shoe_box.take(hand, style, style.order[number], above=_ABOVE, aloft=_ALOFT)


def _put(hand: Hand, style: Style, number: int) -> None:
    """Takes the shoe that is number `number` in order, and puts it down in its slot."""
    _lift(hand, style, number)
    shoe_box.carry(hand, style, style.drops[style.order[number]])
    release(hand, style.pace, pause=style.pauses[3 + number])


def _follow(hand: Hand, rng: np.random.Generator, kind: str) -> None:
    """Plays the script of a kind, from its beginning to its end."""
    style = _style(rng)
    hand.rest(style.pauses[0])
    shoe_box.open_lid(hand, style)
    if kind == "lid closed again":
        if rng.random() < 0.5:
            _put(hand, style, 0)
        return shoe_box.close_lid(hand, style)
    if kind != "lid only":
        _put(hand, style, 0)
    if kind in ("success", EARLY):
        _put(hand, style, 1)
    elif kind == "shoe back in":
        _lift(hand, style, 1)
        side = -0.083 if style.order[1] == 0 else 0.083
        shoe_box.carry(hand, style, (side, rng.uniform(-0.02, 0.02), rng.uniform(0.06, 0.1)))
        release(hand, style.pace)
    elif kind == "shoe held":
        _lift(hand, style, 1)
        x, y = SLOTS[style.order[1]]
        shoe_box.carry(hand, style, (x, y, rng.uniform(0.15, 0.25)))
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

BOX = (0.493, -0.15, 0.0)  # x, y, yaw
_PLACES = ((-0.084, 0.0, 0.0), (0.084, 0.0, 0.0))  # of the shoes, in the box's frame
_LOOSE = (0.002, 0.02, 0.05)  # x, y, yaw by which a shoe may lie elsewhere
_LOW, _HIGH = (-0.35, 0.18, -1.0), (0.35, 0.60, 0.04)  # beside the box, in its frame
_AHEAD = 0.06  # metres: height of the point to which a shoe is carried
# The middles of shoes that lie beside the box: where they count, and where they clearly do.
_OUT, _CLEARLY = Area((0.5, -0.5), (1.9, 0.2)), Area((0.66, -0.18), (1.3, 0.14))


def _start(key: PRNGKeyArray, share: float) -> Start:
    key_group, key_shoes = jax.random.split(key)
    base = group(key_group, jnp.array([BOX]), share=share)
    unit = jax.random.uniform(key_shoes, (2, 3), minval=-1.0)
    within = jnp.array(_PLACES) + share * unit * jnp.array(_LOOSE)
    frame = Frame(jnp.append(base[0, :2], 0.0), about_z(base[0, 2]))
    spots = jax.vmap(lambda at: out_of(frame, at.at[2].set(0.0)))(within)
    shoes = jnp.concatenate([spots[:, :2], within[:, 2:] + base[0, 2]], axis=1)
    joints = jnp.append(jnp.zeros(1), free_joint(shoes, shoe_box.SHOE_HALF[2]))
    return Start(joints, free_joint(base, 0.0)[None], jnp.zeros((), bool))


def _progress(view: View, things: Boxes) -> StageProgress:
    goals = tuple((*slot, _AHEAD) for slot in SLOTS)
    return with_lid(view, things, Spot(placing.fixture(view, 0), _LOW, _HIGH, goals))


def stages(things: tuple[str, ...], *, half_extent: float) -> Stages:
    """The stages as seen in a picture, in which a shoe held above the table may look as if out."""
    return of_shoes(things, "out", _OUT, _CLEARLY, half_extent=half_extent)


TASK = Task(
    things=("box", "lid", "shoe A", "shoe B"), stages=("lid open", "shoe A out", "shoe B out"),
    scene=shoe_box.scene(), home=HOME, start=_start, boxes=shoe_boxes, progress=_progress,
    episode_length=300, by_boxes=stages, layout=IN_PICTURES,
)  # fmt: skip
ENTRY = Entry(TASK, SCRIPT)
