"""Throw the rubbish into the bin, and no tomato. A Panda at a table; see `tabletop`.

Geometry after RLBench's put_rubbish_in_bin, built anew from primitives: the bin is square, and its
places are a little nearer, so that the arm reaches them when the group is turned. The rubbish is in
one of three places in a row, the tomatoes in the others.

Things: bin, rubbish, tomato A, tomato B.
Stage: the rubbish in: its centre inside the walls and below 0.10 m, and released. Success: it is in
and slower than 0.05 m/s, with no tomato in the bin, at 5 moments in a row.
"""

import jax
import jax.numpy as jnp
from gril_jax.envs.panda.frames import Frame
from gril_jax.envs.stages import Stages
from gril_jax.envs.tabletop import HOME, placing, sight
from gril_jax.envs.tabletop.boxes import Boxes, box, stacked
from gril_jax.envs.tabletop.entry import Entry
from gril_jax.envs.tabletop.from_boxes import Layout
from gril_jax.envs.tabletop.placing import Spot
from gril_jax.envs.tabletop.resting import Space
from gril_jax.envs.tabletop.reward import StageProgress
from gril_jax.envs.tabletop.sight import Area
from gril_jax.envs.tabletop.start import Footprint, Start, free_joint, group, place
from gril_jax.envs.tabletop.task import Task, View
from jaxtyping import PRNGKeyArray

from . import expert, model

BIN = (0.56, -0.24, 0.0)  # x, y, yaw
PLACES = ((0.55, 0.12, 0.0), (0.55, -0.01, 0.0), (0.56, 0.25, 0.0))  # the first without jitter
_BELOW = 0.10  # metres: of the centre of what is in the bin
_HALVES = (model.RUBBISH_HALF, *[(model.RADIUS,) * 3] * 2)
# Where the middle of what lies in the bin is seen, and where it clearly is.
_INSIDE, _CLEARLY = Area((-0.32, -0.4), (0.32, 0.02)), Area((-0.1, -0.26), (0.2, -0.1))


def _start(key: PRNGKeyArray, share: float) -> Start:
    key_group, key_place, key_which = jax.random.split(key, 3)
    places = group(key_group, jnp.array((BIN, *PLACES)), share=share)
    which = jax.random.randint(key_which, (), 0, 3) * (share > 0)
    order = (jnp.arange(3) + which) % 3
    halves = jnp.array([half[:2] for half in _HALVES])
    standing = Footprint(places[:1], jnp.array([model.BIN_HALF[:2]]))
    things, unplaced = place(key_place, Footprint(places[1:][order], halves), standing, share=share)
    joints = free_joint(things, 0.0).reshape(3, 7).at[:, 2].set(jnp.array(_HALVES)[:, 2])
    return Start(joints.reshape(-1), free_joint(places[:1], 0.0)[None], unplaced)


def _boxes(view: View) -> Boxes:
    stands: Frame = placing.fixture(view, 0)
    basket = box(stands, (0.0, 0.0, model.HEIGHT / 2), model.BIN_HALF)
    return stacked([basket, *placing.frees(view.joints, _HALVES)])


def _progress(view: View, things: Boxes) -> StageProgress:
    x, y = model.INSIDE
    frame = placing.fixture(view, 0)
    spot = Spot(frame, (-x, -y, -1.0), (x, y, _BELOW), (0.0, 0.0, 0.28))
    put = placing.put(view, placing.picked(things, 1, 1), placing.speeds(view.rates)[:1], spot)
    spoilt = placing.at(spot, things.position[2:]).any()
    return put._replace(finished=put.finished & ~spoilt)


def stages(things: tuple[str, ...], *, half_extent: float) -> Stages:
    """The stage as seen in a picture; a tomato in the bin is a fault."""
    bin_, rubbish, *tomatoes = range(sight.FIRST, len(things))

    def inside(thing: int):
        name, others = f"{things[thing]} in", (rubbish, *tomatoes)
        return sight.placed(name, thing, bin_, _INSIDE, _CLEARLY, others=others)

    return Stages(
        (inside(rubbish),), movable=(rubbish, *tomatoes), robots=sight.ROBOTS,
        half_extent=half_extent, score=sight.share_without_faults,
        faults=tuple(inside(tomato) for tomato in tomatoes),
    )  # fmt: skip


TASK = Task(
    things=("bin", "rubbish", "tomato A", "tomato B"), stages=("rubbish in",),
    scene=model.scene(), home=HOME, start=_start, boxes=_boxes, progress=_progress,
    episode_length=120, by_boxes=stages,
    layout=Layout((0,), _HALVES, (Space(0, model.INSIDE, model.BIN_HALF[:2]),)),
    colours=((0.45, 0.47, 0.5), (0.72, 0.72, 0.7), (0.8, 0.2, 0.15), (0.8, 0.3, 0.15)),
)  # fmt: skip
ENTRY = Entry(TASK, expert.SCRIPT)
