"""Open the drawer and put the item in. A Panda at a table; see `tabletop`.

Geometry after RLBench's put_item_in_drawer, smaller, so that the arm reaches it, and built anew of
primitives: always the middle drawer. The hand leans by 30 degrees, its palm away from the chest: a
vertical one would meet the chest while its fingers are behind the handle.

Things: chest, drawer (its front with the handle), item.
Stages: the drawer open, by 12 cm; the item in: its centre within the drawer and below its rim, and
released. Success: both, the item slower than 0.05 m/s, at 5 moments in a row.
"""

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.panda.frames import Frame, into, out_of
from gril_jax.envs.stages import Stages
from gril_jax.envs.tabletop import placing, sight
from gril_jax.envs.tabletop.boxes import Boxes, box, stacked
from gril_jax.envs.tabletop.entry import Entry
from gril_jax.envs.tabletop.placing import Spot
from gril_jax.envs.tabletop.reward import StageProgress, closeness
from gril_jax.envs.tabletop.sight import Area
from gril_jax.envs.tabletop.start import NOTHING, Footprint, Start, free_joint, group, place
from gril_jax.envs.tabletop.task import Task, View
from jaxtyping import PRNGKeyArray

from . import expert, model

CHEST = (0.50, -0.16, 0.0)  # x, y, yaw; the item is on its middle
# Tool centre point (0.50, 0.12, 0.50), fingers along x, leaning.
HOME = (0.2356, -0.0317, 0.1934, -1.6894, -0.4705, 1.4392, -0.3679)
_TILT = float(np.radians(-30))
_ENOUGH = 0.18  # metres: where the progress of the first stage ends
# The middle of the drawer's front from the chest's, in its sizes: open. And the item's from the
# drawer's front: in it, and clearly.
# A turned chest has another box: 12 cm are seen as 0.65 to 0.96, 0.81 in the median.
_OPEN, _WIDE = Area((0.7, -0.4), (1.5, 0.5)), Area((0.9, -0.05), (1.1, 0.1))
# Where the rail lets the front be, shut to wide open: means over 256 starts, and how far aside of
# them a start's own rail may be.
_RAIL, _ASIDE = ((0.496, 0.039), (1.071, 0.033)), (0.14, 0.19)
_INSIDE, _CLEARLY = Area((-1.9, -0.4), (-0.4, 0.3)), Area((-1.3, -0.15), (-0.75, 0.0))


def _start(key: PRNGKeyArray, share: float) -> Start:
    key_group, key_item = jax.random.split(key)
    chest = group(key_group, jnp.array([CHEST]), share=share)
    item = Footprint(chest, jnp.array([model.ITEM_HALF[:2]]))
    items, unplaced = place(key_item, item, NOTHING, share=share)
    joints = free_joint(items, model.TOP + model.ITEM_HALF[2])
    return Start(jnp.append(jnp.zeros(1), joints), free_joint(chest, 0.0)[None], unplaced)


def _drawer(view: View) -> Frame:
    chest = placing.fixture(view, 0)
    way = view.joints[0] * jnp.array([0.0, 1.0, 0.0])
    return Frame(out_of(chest, way), chest.rotation)


def _boxes(view: View) -> Boxes:
    chest = box(placing.fixture(view, 0), (0.0, 0.0, model.CHEST_HALF[2]), model.CHEST_HALF)
    front = box(_drawer(view), model.FRONT_CENTER, model.FRONT_HALF)
    return stacked([chest, front, *placing.frees(view.joints[1:], (model.ITEM_HALF,))])


def _progress(view: View, things: Boxes) -> StageProgress:
    drawer, travel = _drawer(view), view.joints[0]
    (low_x, low_y), (high_x, high_y) = model.INSIDE
    spot = Spot(drawer, (low_x, low_y, model.FLOOR), (high_x, high_y, model.RIM), (0.0, 0.03, 0.28))
    item = placing.picked(things, 2, 1)
    local = into(placing.fixture(view, 0), item.position[0])
    ground = jnp.where(local[1] < model.CHEST_HALF[1], model.TOP, 0.0)
    put = placing.put(view, item, placing.speeds(view.rates[1:]), spot, ground=ground)
    is_open = travel > expert.OPEN
    gap = out_of(drawer, jnp.array(model.BAR) - jnp.array([0.0, 0.03, 0.0]))
    pulled = jnp.clip(travel / _ENOUGH, 0.0, 1.0)
    pulling = 0.3 * closeness(view.hand.position, gap) + 0.7 * pulled
    within = jnp.where(is_open, put.within, pulling)
    return StageProgress(jnp.append(is_open, put.done), within, put.finished & is_open)


def stages(things: tuple[str, ...], *, half_extent: float) -> Stages:
    """The stages as seen in a picture, where an item before a shut drawer looks to be in it."""
    chest, drawer, item = range(sight.FIRST, len(things))
    pulled = sight.placed("drawer open", drawer, chest, _OPEN, _WIDE, others=(drawer,))
    put = sight.placed(
        "item in", item, drawer, _INSIDE, _CLEARLY, others=(item,), after=(pulled.name,)
    )
    return Stages(
        (pulled, put), movable=(drawer, item), robots=sight.ROBOTS, half_extent=half_extent,
        score=sight.share_in_order, possible=sight.on_rail(drawer, chest, _RAIL, _ASIDE),
    )  # fmt: skip


TASK = Task(
    things=("chest", "drawer", "item"), stages=("drawer open", "item in"), scene=model.scene(),
    home=HOME, start=_start, boxes=_boxes, progress=_progress, episode_length=200,
    by_boxes=stages, tilt=_TILT,
    colours=((0.62, 0.42, 0.24), (0.78, 0.6, 0.38), (0.45, 0.7, 0.85)),
)  # fmt: skip
ENTRY = Entry(TASK, expert.SCRIPT)
