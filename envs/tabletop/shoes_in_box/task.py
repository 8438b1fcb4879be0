"""Put both shoes into the box, after opening its lid. A Panda at a table; see `tabletop`.

Geometry after RLBench's put_shoes_in_box and the box of its open_box, built anew from primitives;
resets after it too: all things are moved as a group by up to 4 cm and 22.5 degrees, each shoe by up
to 2 cm and 0.3 rad. Unlike RLBench's, the grasp is one of friction.

Things: box, lid, shoe A (the nearer to the box at reset), shoe B.
Stages: the lid open (it has been at more than 90 degrees: gravity keeps it there), shoe A in, shoe
B in: the centre inside the walls and below 0.12 m, and released. Success: both shoes are in, slower
than 0.05 m/s, at 5 moments in a row; the lid may be at any angle then, as in RLBench.
Progress within a stage: reaching for the lip and the lid's angle; or, for the shoe outside that is
nearer to the box: reaching, holding it off the ground, its way to a point above the floor of the
box, and letting it go inside.
"""

import jax
import jax.numpy as jnp
from gril_jax.envs.panda.frames import Frame, compose, out_of
from gril_jax.envs.tabletop import HOME, placing
from gril_jax.envs.tabletop.boxes import Boxes, box, stacked
from gril_jax.envs.tabletop.entry import Entry
from gril_jax.envs.tabletop.from_boxes import Layout, Rail
from gril_jax.envs.tabletop.placing import Spot
from gril_jax.envs.tabletop.resting import Space
from gril_jax.envs.tabletop.reward import StageProgress, closeness
from gril_jax.envs.tabletop.start import Footprint, Start, free_joint, group, place
from gril_jax.envs.tabletop.task import Task, View
from jaxtyping import Array, Float, PRNGKeyArray

from . import expert, model, stages

LAYOUT = ((0.493, -0.15, 0.0), (0.48, 0.14, 0.0), (0.48, 0.27, 0.0))  # box, shoes: x, y, yaw
_OPEN, _OPENED = 1.571, 1.6  # rad: the stage, and where its progress ends
_BELOW_RIM = 0.12  # metres: of a shoe's centre; two on top of each other are
_DROP = (0.0, 0.0, 0.12)  # in the box's frame
# Half extents of the box with its lip, as if that stood out on both sides.
_ROOM = (model.BOX_HALF[0], model.HINGE[1] + model.LIP[1] + 0.006)
IN_PICTURES = Layout(
    standing=(0,), loose=(model.SHOE_HALF,) * 2,
    spaces=(Space(0, model.FLOOR_HALF, model.BOX_HALF[:2]),),
    rails=(Rail(1, *model.LID_RANGE, _OPEN),),
)  # fmt: skip


def _start(key: PRNGKeyArray, share: float) -> Start:
    key_group, key_shoes = jax.random.split(key)
    places = group(key_group, jnp.array(LAYOUT), share=share)
    halves = jnp.broadcast_to(jnp.array(model.SHOE_HALF[:2]), (2, 2))
    standing = Footprint(places[:1], jnp.array([_ROOM]))
    shoes, unplaced = place(key_shoes, Footprint(places[1:], halves), standing, share=share)
    joints = jnp.concatenate([jnp.zeros(1), free_joint(shoes, model.SHOE_HALF[2])])
    return Start(joints, free_joint(places[:1], 0.0)[None], unplaced)


def shoe_boxes(view: View) -> Boxes:
    """Boxes of the box, its lid and the shoes."""
    base, angle = placing.fixture(view, 0), view.joints[0]
    c, s, one, zero = jnp.cos(angle), jnp.sin(angle), jnp.ones(()), jnp.zeros(())
    turn = jnp.stack([one, zero, zero, zero, c, -s, zero, s, c]).reshape(3, 3)
    hinge = Frame(out_of(base, jnp.array(model.HINGE)), compose(base.rotation, turn))
    found = [
        box(base, (0.0, 0.0, model.RIM / 2), model.BOX_HALF),
        box(hinge, model.LID_CENTER, model.LID_HALF),
        *placing.frees(view.joints[1:], (model.SHOE_HALF,) * 2),
    ]
    return stacked(found)


def _progress(view: View, things: Boxes) -> StageProgress:
    (half_x, half_y), low = model.FLOOR_HALF, -1.0
    spot = Spot(
        placing.fixture(view, 0), (-half_x, -half_y, low), (half_x, half_y, _BELOW_RIM), _DROP
    )
    return with_lid(view, things, spot)


def with_lid(view: View, things: Boxes, spot: Spot) -> StageProgress:
    """Progress of a task that opens the lid and brings both shoes to a spot."""
    shoes = placing.picked(things, 2, 2)
    put = placing.put(view, shoes, placing.speeds(view.rates[1:]), spot)
    lid_open = view.reached[0] | (view.joints[0] > _OPEN)
    done = jnp.concatenate([lid_open[None], put.done])
    within = jnp.where(lid_open, put.within, _opening(view, things))
    return StageProgress(done, within, put.finished)


def _opening(view: View, things: Boxes) -> Float[Array, ""]:
    """Progress of the first stage."""
    lid = Frame(things.position[1], things.rotation[1])
    lip = out_of(lid, jnp.array(model.LIP) - jnp.array(model.LID_CENTER))
    turned = jnp.clip(view.joints[0] / _OPENED, 0.0, 1.0)
    return 0.25 * closeness(view.hand.position, lip) + 0.75 * turned


TASK = Task(
    things=("box", "lid", "shoe A", "shoe B"), stages=("lid open", "shoe A in", "shoe B in"),
    scene=model.scene(), home=HOME, start=_start, boxes=shoe_boxes, progress=_progress,
    episode_length=300, by_boxes=stages.stages, layout=IN_PICTURES,
)  # fmt: skip
ENTRY = Entry(TASK, expert.SCRIPT)
shoes_in_box, demonstrate = ENTRY.make, ENTRY.demonstrate
