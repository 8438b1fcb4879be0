"""Take both shoes out of the box, after opening its lid. A Panda at a table; see `tabletop`.

The scene of shoes in the box, after RLBench's take_shoes_out_of_box: the shoes lie in it end to
end. Starts move the box by up to 4 cm and 22.5 degrees, and each shoe by what the box leaves it.

Things: box, lid, shoe A (the robot's side), shoe B.
Stages: the lid open (as for shoes in the box), shoe A out, shoe B out: on the table at the robot's
left of the box, and released. Success: both shoes are out, slower than 0.05 m/s, at 5 moments in a
row; the lid may be at any angle then.
"""

import jax
import jax.numpy as jnp
from gril_jax.envs.panda.frames import Frame, about_z, out_of
from gril_jax.envs.stages import Stages
from gril_jax.envs.tabletop import HOME, placing
from gril_jax.envs.tabletop.boxes import Boxes
from gril_jax.envs.tabletop.entry import Entry
from gril_jax.envs.tabletop.placing import Spot
from gril_jax.envs.tabletop.reward import StageProgress
from gril_jax.envs.tabletop.shoes_in_box import model
from gril_jax.envs.tabletop.shoes_in_box.stages import of_shoes
from gril_jax.envs.tabletop.shoes_in_box.task import IN_PICTURES, shoe_boxes, with_lid
from gril_jax.envs.tabletop.sight import Area
from gril_jax.envs.tabletop.start import Start, free_joint, group
from gril_jax.envs.tabletop.task import Task, View
from jaxtyping import PRNGKeyArray

from . import expert

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
    joints = jnp.append(jnp.zeros(1), free_joint(shoes, model.SHOE_HALF[2]))
    return Start(joints, free_joint(base, 0.0)[None], jnp.zeros((), bool))


def _progress(view: View, things: Boxes) -> StageProgress:
    goals = tuple((*slot, _AHEAD) for slot in expert.SLOTS)
    return with_lid(view, things, Spot(placing.fixture(view, 0), _LOW, _HIGH, goals))


def stages(things: tuple[str, ...], *, half_extent: float) -> Stages:
    """The stages as seen in a picture, in which a shoe held above the table may look as if out."""
    return of_shoes(things, "out", _OUT, _CLEARLY, half_extent=half_extent)


TASK = Task(
    things=("box", "lid", "shoe A", "shoe B"), stages=("lid open", "shoe A out", "shoe B out"),
    scene=model.scene(), home=HOME, start=_start, boxes=shoe_boxes, progress=_progress,
    episode_length=300, by_boxes=stages, layout=IN_PICTURES,
)  # fmt: skip
ENTRY = Entry(TASK, expert.SCRIPT)
