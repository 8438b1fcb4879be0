"""RLBench's put_shoes_in_box: open the lid, then put both shoes in.

Things: box, lid, shoe A (the nearer to the box at reset), shoe B.
Stages: the lid open (it has been at more than 90 degrees: gravity keeps it there), shoe A in, shoe
B in: the centre inside the walls and below 0.12 m, and released. Success: both shoes are in, slower
than 0.05 m/s, in 5 frames in a row; the lid may be at any angle then, as in RLBench.
Progress: reaching for the lip and the lid's angle; or, for the shoe outside that is nearer to the
box: reaching, holding it off the ground, its way to above the box's floor, letting it go inside.
"""

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.panda.kinematics import Frame, compose, out_of
from gril_jax.envs.panda.model import DOFS
from gril_jax.envs.stages import Stage, Stages
from gril_jax.envs.tabletop import HOME, placing
from gril_jax.envs.tabletop.boxes import Boxes, box, stacked
from gril_jax.envs.tabletop.demonstrations import Entry
from gril_jax.envs.tabletop.moves import Hand, release, wander
from gril_jax.envs.tabletop.placing import ROBOTS, Area, Spot, placed, relative, share_that_holds
from gril_jax.envs.tabletop.recorded import EARLY, Run, Script
from gril_jax.envs.tabletop.resting import Layout, Rail, Space
from gril_jax.envs.tabletop.reward import StageProgress, closeness
from gril_jax.envs.tabletop.start import Footprint, Start, free_joint, group, place
from gril_jax.envs.tabletop.task import Task, View
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from . import shoe_box
from .shoe_box import Style, draw_style

BOX, LID, SHOES = 3, 4, (5, 6)
_OPEN, _OPENED = 1.571, 1.6  # rad, of the hinge: the stage, and where its progress ends

# Angle of the hinge, rad; middle of the lid's box, in sizes of the box; its width and height, as
# shares of those when it is closed. Up to 0.1 rad a box changes less than a layout varies.
LID_CURVE = (
    (0.0, (0.054, 0.161), (1.0, 1.0)), (0.1, (0.053, 0.192), (1.0, 1.0)),
    (0.4, (0.025, 0.288), (0.959, 1.192)), (0.8, (-0.078, 0.396), (0.780, 1.486)),
    (1.2, (-0.241, 0.471), (0.484, 1.686)), (1.571, (-0.444, 0.495), (0.355, 1.746)),
    (2.0, (-0.658, 0.463), (0.748, 1.665)), (2.3, (-0.772, 0.406), (0.951, 1.514)),
    (2.6, (-0.840, 0.329), (1.070, 1.305)),
)  # fmt: skip
_AT_REST, _ASIDE = (2.4, 2.6), 0.05  # where an open lid lies, rad, and how exactly
_GUIDED = (0.125, 0.125)  # how far a start's own curve is aside of the mean one
# Middles of shoes on the box's floor: where they count, and where they clearly do.
_INSIDE = Area((-0.32, -0.30), (0.32, 0.20))
_CLEARLY = Area((-0.22, -0.20), (0.22, 0.10))


def stages(things: tuple[str, ...], *, half_extent: float) -> Stages:
    """The stages of the task in a picture |x|, |y| <= `half_extent`; `things` name the objects."""
    return of_shoes(things, "in", _INSIDE, _CLEARLY, half_extent=half_extent)


def of_shoes(
    things: tuple[str, ...], where: str, area: Area, clearly: Area, *, half_extent: float
) -> Stages:
    """The stages of a task that opens the lid and brings both shoes into an area."""
    lid = Stage(f"{things[LID]} open", (LID,), _lid_open, _open_lid)
    shoes = (
        placed(f"{things[i]} {where}", i, BOX, area, clearly, others=SHOES, after=(lid.name,))
        for i in SHOES
    )
    return Stages(
        (lid, *shoes), movable=(LID, *SHOES), robots=ROBOTS, half_extent=half_extent,
        score=share_that_holds, sizes=_sizes,
        possible=placing.on_rail(LID, BOX, [middle for _, middle, _ in LID_CURVE], _GUIDED),
    )  # fmt: skip


def _curve():
    angle, middle, shares = zip(*LID_CURVE, strict=True)
    return jnp.array(angle), jnp.array(middle), jnp.array(shares)


def _nearest(center, size):
    """The curve's point nearest to the lid: its segment, and its share along it."""
    return placing.nearest_on(_curve()[1], relative(LID, BOX, center, size))


def _between(values, segment, share):
    return values[segment] + share * (values[segment + 1] - values[segment])


def _sizes(center: Float[Array, "N 2"], size: Float[Array, "N 2"]) -> Float[Array, "N 2"]:
    segment, share = _nearest(center, size)
    return size.at[LID].multiply(_between(_curve()[2], segment, share))


def _lid_open(center: Float[Array, "N 2"], size: Float[Array, "N 2"]) -> Bool[Array, ""]:
    return _between(_curve()[0], *_nearest(center, size)) > _OPEN


def _open_lid(
    key: PRNGKeyArray, center: Float[Array, "N 2"], size: Float[Array, "N 2"]
) -> Float[Array, "N 2"]:
    key_angle, key_aside = jax.random.split(key)
    low, high = _AT_REST
    at = jax.random.uniform(key_angle, (), minval=low, maxval=high)
    angles, middle, _ = _curve()
    place = jnp.stack([jnp.interp(at, angles, middle[:, axis]) for axis in range(2)])
    place += jax.random.uniform(key_aside, (2,), minval=-_ASIDE, maxval=_ASIDE)
    return center.at[LID].set(center[BOX] + place * size[BOX])


KINDS = (
    "success",  # lid, then both shoes in either order
    "lid only",  # the lid, then nothing
    "one shoe",  # the lid and one shoe
    "shoe outside",  # the other shoe is let go beside the box
    "lid closed again",  # the lid is pushed shut when one shoe is in, or none
    EARLY,
    "wrong order",  # a shoe is put on the closed lid before that is opened
    "shoe knocked away",  # a shoe is struck out of reach, the other put in
)
_SHUT = 0.1  # rad, of the lid
_OFF_TABLE = 0.1  # metres: the centre of a carried shoe
_ON_LID = (0.17, 0.25)  # metres: the centre of a shoe that lies on the closed lid
_FAR = 0.1  # metres


def _put_shoe(hand: Hand, style: Style, number: int, *, where=None) -> None:
    """Takes the shoe that is number `number` in order and releases it in the box, or elsewhere."""
    hand.rest(style.pauses[1 + number])
    shoe_box.take(hand, style, style.order[number])
    shoe_box.carry(hand, style, style.drops[number] if where is None else where)
    release(hand, style.pace, pause=style.pauses[3 + number])


def _follow(hand: Hand, rng: np.random.Generator, kind: str) -> None:
    """Plays the script of a kind, from its beginning to its end."""
    style = draw_style(rng)
    hand.rest(style.pauses[0])
    if kind == "wrong order":
        _put_shoe(hand, style, 0, where=(*style.drops[0][:2], 0.2))
    shoe_box.open_lid(hand, style)
    if kind == "shoe knocked away":
        angle = shoe_box.box_yaw(hand) + rng.uniform(-0.4, 0.4)  # away from the robot
        shoe_box.knock(hand, style, style.order[1], (np.cos(angle), np.sin(angle)))
    if kind == "lid closed again":
        if rng.random() < 0.5:
            _put_shoe(hand, style, 0)
        shoe_box.close_lid(hand, style)
    elif kind not in ("lid only", "wrong order"):
        _put_shoe(hand, style, 0)
    if kind in ("success", EARLY, "wrong order"):
        _put_shoe(hand, style, 1)
    if kind == "shoe outside":
        _put_shoe(hand, style, 1, where=(rng.uniform(-0.12, 0.12), rng.uniform(0.2, 0.26), 0.1))
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
    number, opened = int(inside.sum()), bool((lid > _OPEN).any())
    lifted = shoes[:, :, 2].max(axis=0) > _OFF_TABLE
    away = np.linalg.norm(shoes[-1, :, :2] - shoes[0, :, :2], axis=1)
    down = (shoes[-1, ~inside, 2] < _OFF_TABLE).all()
    left = number == 1 and not lifted[~inside].any()  # the other shoe was not taken
    over = np.linalg.norm(shoes[:, :, :2] - box, axis=2) < shoe_box.BOX_HALF[0]
    on_lid = over & (shoes[:, :, 2] > _ON_LID[0]) & (shoes[:, :, 2] < _ON_LID[1])
    marks = {
        "lid only": lid[-1] > _OPEN and number == 0 and not lifted.any(),
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
    lid, box = run.qpos[:, DOFS], run.fixtures[0, :2]
    return shows(run.kind, shoes, lid, run.stages[-1, 1:], box)


SCRIPT = Script(KINDS, _follow, _shows)
LAYOUT = ((0.493, -0.15, 0.0), (0.48, 0.14, 0.0), (0.48, 0.27, 0.0))  # box, shoes: x, y, yaw
_BELOW_RIM = 0.12  # metres: of a shoe's centre; two on top of each other are
_DROP = (0.0, 0.0, 0.12)  # in the box's frame
# Half extents of the box with its lip, as if that stood out on both sides.
_ROOM = (shoe_box.BOX_HALF[0], shoe_box.HINGE[1] + shoe_box.LIP[1] + 0.006)
IN_PICTURES = Layout(
    standing=(0,), loose=(shoe_box.SHOE_HALF,) * 2,
    spaces=(Space(0, shoe_box.FLOOR_HALF, shoe_box.BOX_HALF[:2]),),
    rails=(Rail(1, *shoe_box.LID_RANGE, _OPEN),),
)  # fmt: skip


def _start(key: PRNGKeyArray, share: float) -> Start:
    key_group, key_shoes = jax.random.split(key)
    places = group(key_group, jnp.array(LAYOUT), share=share)
    halves = jnp.broadcast_to(jnp.array(shoe_box.SHOE_HALF[:2]), (2, 2))
    standing = Footprint(places[:1], jnp.array([_ROOM]))
    shoes, unplaced = place(key_shoes, Footprint(places[1:], halves), standing, share=share)
    joints = jnp.concatenate([jnp.zeros(1), free_joint(shoes, shoe_box.SHOE_HALF[2])])
    return Start(joints, free_joint(places[:1], 0.0)[None], unplaced)


def shoe_boxes(view: View) -> Boxes:
    """Boxes of the box, its lid and the shoes."""
    base, angle = placing.fixture(view, 0), view.joints[0]
    c, s, one, zero = jnp.cos(angle), jnp.sin(angle), jnp.ones(()), jnp.zeros(())
    turn = jnp.stack([one, zero, zero, zero, c, -s, zero, s, c]).reshape(3, 3)
    hinge = Frame(out_of(base, jnp.array(shoe_box.HINGE)), compose(base.rotation, turn))
    found = [
        box(base, (0.0, 0.0, shoe_box.RIM / 2), shoe_box.BOX_HALF),
        box(hinge, shoe_box.LID_CENTER, shoe_box.LID_HALF),
        *placing.frees(view.joints[1:], (shoe_box.SHOE_HALF,) * 2),
    ]
    return stacked(found)


def _progress(view: View, things: Boxes) -> StageProgress:
    (half_x, half_y), low = shoe_box.FLOOR_HALF, -1.0
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
    lip = out_of(lid, jnp.array(shoe_box.LIP) - jnp.array(shoe_box.LID_CENTER))
    turned = jnp.clip(view.joints[0] / _OPENED, 0.0, 1.0)
    return 0.25 * closeness(view.hand.position, lip) + 0.75 * turned


TASK = Task(
    things=("box", "lid", "shoe A", "shoe B"), stages=("lid open", "shoe A in", "shoe B in"),
    scene=shoe_box.scene(), home=HOME, start=_start, boxes=shoe_boxes, progress=_progress,
    episode_length=300, by_boxes=stages, layout=IN_PICTURES,
)  # fmt: skip
ENTRY = Entry(TASK, SCRIPT)
