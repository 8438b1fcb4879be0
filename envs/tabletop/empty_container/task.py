"""Bring three blocks from the tray into the bin. A Panda at a table; see `tabletop`.

Geometry after RLBench's empty_container, built anew from primitives: three blocks take the place of
its random solids, and the bin is always the one at the robot's right.

Things: tray, bin, other bin, block A (the nearest to the bin), block B, block C.
Stages: block A in, block B in, block C in: the centre inside the bin's walls and below 0.06 m, and
released; in any order. Success: all are in, slower than 0.05 m/s, at 5 moments in a row.
"""

import jax
import jax.numpy as jnp
from gril_jax.envs.stages import Stages
from gril_jax.envs.tabletop import HOME, placing, sight
from gril_jax.envs.tabletop.boxes import Boxes, box, stacked
from gril_jax.envs.tabletop.entry import Entry
from gril_jax.envs.tabletop.from_boxes import Layout
from gril_jax.envs.tabletop.placing import Spot
from gril_jax.envs.tabletop.resting import Space
from gril_jax.envs.tabletop.reward import StageProgress
from gril_jax.envs.tabletop.sight import Area
from gril_jax.envs.tabletop.start import NOTHING, Footprint, Start, free_joint, group, place
from gril_jax.envs.tabletop.task import Task, View
from jaxtyping import PRNGKeyArray

from . import expert, model

LAYOUT = (  # tray, bin, other bin, blocks: x, y, yaw
    (0.50, 0.0, 0.0), (0.50, -0.25, 0.0), (0.50, 0.25, 0.0),
    (0.43, -0.06, 0.0), (0.57, 0.0, 0.0), (0.43, 0.06, 0.0),
)  # fmt: skip
_SHARE = 0.75  # of the ranges by which things on other tasks' tables are moved: walls are near
_BELOW = 0.06  # metres: of a centre; two blocks may lie on each other
# Where the middle of a block in the bin is seen, and where that of one that lies across it clearly
# is: it is longer than half the bin's width.
_INSIDE, _CLEARLY = Area((-0.5, -0.45), (0.5, 0.42)), Area((-0.15, -0.22), (0.19, 0.2))
# Nothing bounds what is in the other bin, which is painted alone.
_SPACES = tuple(
    Space(i, space, model.outside(space)[:2]) for i, space in enumerate((model.TRAY, model.BIN))
)


def _start(key: PRNGKeyArray, share: float) -> Start:
    key_group, key_blocks = jax.random.split(key)
    places = group(key_group, jnp.array(LAYOUT), share=share)
    halves = jnp.array([half[:2] for half in model.BLOCKS])
    blocks, unplaced = place(
        key_blocks, Footprint(places[3:], halves), NOTHING, share=_SHARE * share
    )
    joints = free_joint(blocks, 0.0).reshape(3, 7).at[:, 2].set(jnp.array(model.BLOCKS)[:, 2])
    return Start(joints.reshape(-1), free_joint(places[:3], 0.0).reshape(3, 7), unplaced)


def _boxes(view: View) -> Boxes:
    spaces = (model.TRAY, model.BIN, model.BIN)
    middle = (0.0, 0.0, model.HEIGHT / 2)
    standing = [
        box(placing.fixture(view, i), middle, model.outside(space))
        for i, space in enumerate(spaces)
    ]
    return stacked([*standing, *placing.frees(view.joints, model.BLOCKS)])


def _progress(view: View, things: Boxes) -> StageProgress:
    x, y = model.BIN
    spot = Spot(placing.fixture(view, 1), (-x, -y, -1.0), (x, y, _BELOW), (0.0, 0.0, 0.1))
    return placing.put(view, placing.picked(things, 3, 3), placing.speeds(view.rates), spot)


def stages(things: tuple[str, ...], *, half_extent: float) -> Stages:
    """The stages as seen in a picture."""
    bin_, *blocks = (sight.FIRST + i for i in (1, 3, 4, 5))
    return Stages(
        tuple(
            sight.placed(f"{things[i]} in", i, bin_, _INSIDE, _CLEARLY, others=tuple(blocks))
            for i in blocks
        ),
        movable=tuple(blocks), robots=sight.ROBOTS, half_extent=half_extent,
        score=sight.share_that_holds,
    )  # fmt: skip


TASK = Task(
    things=("tray", "bin", "other bin", "block A", "block B", "block C"),
    stages=("block A in", "block B in", "block C in"), scene=model.scene(), home=HOME,
    start=_start, boxes=_boxes, progress=_progress, episode_length=300, by_boxes=stages,
    max_contacts=32, layout=Layout((0, 1, 2), model.BLOCKS, _SPACES),
    colours=((0.6, 0.6, 0.62), (0.75, 0.22, 0.2), (0.2, 0.35, 0.7), (0.3, 0.3, 0.32),
             (0.42, 0.44, 0.36), (0.36, 0.3, 0.4)),
)  # fmt: skip
ENTRY = Entry(TASK, expert.SCRIPT)
