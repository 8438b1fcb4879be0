"""RLBench's put_item_in_drawer: pull the drawer open and put the item in.

Things: chest, drawer (its front with the handle), item; it is always the middle drawer, and the
hand leans by 30 degrees, or it would meet the chest while its fingers are behind the handle.
Stages: the drawer open, by 12 cm; the item in: its centre within the drawer and below its rim, and
released. Success: both, the item slower than 0.05 m/s, in 5 frames in a row.
Places are in the chest's frame: its origin on the table below its middle, the drawer towards +y.
"""

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.panda.kinematics import Frame, into, out_of
from gril_jax.envs.panda.model import PADS, PALM, TIPS
from gril_jax.envs.stages import Stages
from gril_jax.envs.tabletop import moves, physics, placing
from gril_jax.envs.tabletop.boxes import Boxes, box, stacked
from gril_jax.envs.tabletop.demonstrations import Entry
from gril_jax.envs.tabletop.moves import CLOSED, Hand, Pace
from gril_jax.envs.tabletop.physics import TABLE, Additions
from gril_jax.envs.tabletop.placing import Area, Spot
from gril_jax.envs.tabletop.recorded import EARLY, Run, Script
from gril_jax.envs.tabletop.resting import Layout, Rail, Space
from gril_jax.envs.tabletop.reward import StageProgress, closeness
from gril_jax.envs.tabletop.start import NOTHING, Footprint, Start, free_joint, group, place
from gril_jax.envs.tabletop.task import Task, View
from jaxtyping import PRNGKeyArray

CHEST_HALF = (0.15, 0.15, 0.17)
TRAVEL = 0.22
FLOOR, RIM = 0.154, 0.244  # heights in the drawer
INSIDE = ((-0.12, -0.13), (0.12, 0.14))  # the drawer's space, x and y of its frame
_TROUGH = ((0.12, 0.13), (0.13, 0.15))  # the same, half extents without and with the walls
BAR = (0.0, 0.21, 0.197)  # the middle of the handle, in the drawer's frame
FRONT_CENTER, FRONT_HALF = (0.0, 0.179, 0.197), (0.13, 0.038, 0.05)  # with the handle
ITEM_HALF = (0.02, 0.02, 0.02)
TOP = 2 * CHEST_HALF[2]

_PLATES = {
    "drawer_floor": ((0.0, 0.005, 0.15), (0.12, 0.135, 0.004)),
    "drawer_back": ((0.0, -0.134, 0.197), (0.12, 0.004, 0.047)),
    "drawer_near": ((-0.124, 0.0, 0.197), (0.004, 0.138, 0.047)),
    "drawer_far": ((0.124, 0.0, 0.197), (0.004, 0.138, 0.047)),
}
_FRONT = ((0.0, 0.145, 0.197), (0.13, 0.005, 0.05))
_CHEST = {
    "chest_top": ((0.0, 0.0, 0.334), (0.15, 0.15, 0.006)),
    "chest_front": ((0.0, 0.145, 0.294), (0.15, 0.005, 0.034)),
}
_PAINTED = (  # sides, back, floor, and the front of the drawer below
    ((-0.145, 0.0, 0.164), (0.005, 0.15, 0.164)), ((0.145, 0.0, 0.164), (0.005, 0.15, 0.164)),
    ((0.0, -0.145, 0.164), (0.14, 0.005, 0.164)), ((0.0, 0.145, 0.07), (0.14, 0.005, 0.07)),
)  # fmt: skip


def _drawer_mjcf() -> str:
    x, y, z = BAR
    posts = (physics.box("", (side * 0.045, y - 0.03, z), (0.005, 0.03, 0.005)) for side in (-1, 1))
    bar = f'fromto="{x - 0.05} {y} {z} {x + 0.05} {y} {z}"'
    trough = "".join(physics.box(name, *shape, 0.2) for name, shape in _PLATES.items())
    return (
        '<body name="drawer"><joint name="slide" type="slide" axis="0 1 0"'
        f' range="0 {TRAVEL}" damping="4" frictionloss="1" armature="0.1"/>'
        f"{physics.box('drawer_front', *_FRONT, 0.4)}{''.join(posts)}"
        f'<geom name="handle" type="capsule" size="0.007" mass="0.05" {bar}/>'
        f'<body name="trough">{trough}</body></body>'
    )


def _scene() -> Additions:
    """The scene; joints after the arm's are the drawer's slide (metres), then the item's."""
    shapes = [physics.box(name, *shape) for name, shape in _CHEST.items()]
    shapes += [physics.box("", *shape) for shape in _PAINTED]
    item = physics.loose("item", physics.box("item", (0, 0, 0), ITEM_HALF, 0.064))
    solid = (*_CHEST, "drawer_front")
    pairs = [("item", other) for other in (TABLE, *PADS, *_PLATES, *solid)]
    pairs += [(tip, other) for tip in TIPS for other in (TABLE, "handle", *_PLATES, *solid)]
    pairs += [(PALM, other) for other in (*solid, "handle")]
    return Additions(physics.fixed("chest", *shapes, _drawer_mjcf()) + item, tuple(pairs))


KINDS = (
    "success",  # the drawer is pulled open by its handle, the item taken and let go above it
    "drawer only",  # the drawer, then nothing
    "pulled too little",  # the drawer is left nearly closed
    "closed again",  # the drawer is opened and pushed shut
    "item outside",  # the drawer is opened, and the item let go on the table
    "wrong order",  # the item is put on the table before the drawer is opened
    "item knocked off",  # the item is struck off the chest after the drawer is opened
    EARLY,
)
_SLIDE, _ITEM = 9, 10  # positions of the joints
_BEHIND, _BELOW = 0.032, 0.006  # metres: the fingers behind the middle of the bar, and below
_TAKE = 0.004  # the tool centre point above the middle of the item
_ABOVE = 0.43  # height from which the hand goes down to the item
OPEN = 0.12  # metres: the drawer counts as open
_SHUT = 0.03
_NARROW = -0.2  # of the gripper: the item does not pass between the fingers


def _at(hand: Hand, *point: float) -> np.ndarray:
    return moves.out_of(hand.fixtures[0], point)


def _yaw(hand: Hand) -> float:
    """The hand's yaw before the chest: its fingers open along the chest's front."""
    return moves.yaw_of(hand.fixtures[0, 3:]) + np.pi / 2


def _pull(hand: Hand, rng: np.random.Generator, pace: Pace, *, by: float) -> None:
    """Hooks closed fingers behind the handle, pulls, and goes up."""
    x, speed = rng.uniform(-0.025, 0.025), rng.uniform(0.15, 0.25)
    _, bar, height = BAR
    bar += float(hand.qpos[_SLIDE])
    hand.grip = CLOSED
    hand.move(_at(hand, x, bar - _BEHIND, 0.3), speed=pace.speed, yaw=_yaw(hand))
    low = height - _BELOW - rng.uniform(0.0, 0.006)
    ways = ((bar - _BEHIND, low), (bar - _BEHIND + by + 0.015, low), (bar - 0.045 + by, low))
    moves.stroke(hand, [_at(hand, x, *way) for way in ways], speed=speed, yaw=_yaw(hand))
    hand.move(_at(hand, x, bar - 0.045 + by, pace.arc), speed=pace.speed)


def _shut(hand: Hand, pace: Pace) -> None:
    """Pushes the drawer shut at its handle."""
    _, bar, height = BAR
    away = bar + float(hand.qpos[_SLIDE]) + 0.05
    ways = ((away, pace.arc), (away, height), (bar + 0.012, height), (away, height + 0.1))
    moves.stroke(hand, [_at(hand, 0.0, *way) for way in ways], speed=0.2, yaw=_yaw(hand))


def _take(hand: Hand, pace: Pace) -> None:
    """Takes the item, and tries again if it slips."""
    for _ in range(2):
        place = moves.pose(hand, _ITEM)
        turn = moves.yaw_of(place[3:]) - _yaw(hand)
        yaw = _yaw(hand) + (turn + np.pi / 4) % (np.pi / 2) - np.pi / 4
        depth = place[2] + _TAKE
        moves.grasp(hand, place[:2], pace, depth=depth, above=_ABOVE, yaw=yaw)
        if moves.holds(hand, _ITEM, above=_ABOVE):
            return


def _put(hand: Hand, pace: Pace, *where: float) -> None:
    moves.carry(hand, _at(hand, *where), pace, yaw=_yaw(hand))
    moves.release(hand, pace)


def _follow(hand: Hand, rng: np.random.Generator, kind: str) -> None:
    """Plays the script of a kind, from its beginning to its end."""
    pace = moves.draw_pace(rng, (0.48, 0.55))
    pauses = rng.integers(0, 10, 3)
    beside = (rng.uniform(-0.12, -0.02), rng.uniform(0.46, 0.49), 0.05)
    hand.rest(int(pauses[0]))
    if kind == "wrong order":
        _take(hand, pace)
        _put(hand, pace, *beside)
    if kind == "pulled too little":
        _pull(hand, rng, pace, by=rng.uniform(0.04, 0.09))
    else:
        _pull(hand, rng, pace, by=rng.uniform(0.2, 0.23))
    hand.rest(int(pauses[1]))
    if kind == "closed again":
        _shut(hand, pace)
    elif kind == "item knocked off":
        back = moves.yaw_of(hand.fixtures[0, 3:]) - np.pi / 2 + rng.uniform(-0.2, 0.2)
        place, way = moves.pose(hand, _ITEM), (np.cos(back), np.sin(back))
        high, yaw = TOP + 0.02, _yaw(hand)
        moves.knock(hand, place, pace, way, height=high, reach=0.2, grip=_NARROW, yaw=yaw)
    elif kind in ("success", EARLY, "item outside"):
        _take(hand, pace)
        hand.rest(int(pauses[2]))
        inside = (rng.uniform(-0.05, 0.05), rng.uniform(0.22, 0.27), rng.uniform(0.26, 0.3))
        _put(hand, pace, *(beside if kind == "item outside" else inside))
    if kind in ("drawer only", "pulled too little"):
        hand.rest(int(rng.integers(5, 40)))


def _shows(run: Run) -> bool:
    """True if positions alone show that an episode without success is of its kind of failure."""
    item, slide = run.qpos[:, _ITEM : _ITEM + 3], run.qpos[:, _SLIDE]
    lifted = item[:, 2].max() > _ABOVE
    down = item[-1, 2] < FLOOR
    still = np.linalg.norm(item[-1] - item[0]) < 0.02
    moment = lambda held: int(held.argmax()) if held.any() else len(held)  # noqa: E731
    first, opened = moment(item[:, 2] > _ABOVE), moment(slide > OPEN)
    marks = {
        "drawer only": still and slide[-1] > OPEN,
        "pulled too little": still and _SHUT / 2 < slide[-1] < OPEN,
        "closed again": still and slide.max() > OPEN and slide[-1] < _SHUT,
        "item outside": lifted and down and opened < first,
        "wrong order": lifted and down and first < opened < len(slide),
        "item knocked off": not lifted and down and slide.max() > OPEN,
    }
    return bool(marks[run.kind])


SCRIPT = Script(KINDS, _follow, _shows)

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
    item = Footprint(chest, jnp.array([ITEM_HALF[:2]]))
    items, unplaced = place(key_item, item, NOTHING, share=share)
    joints = free_joint(items, TOP + ITEM_HALF[2])
    return Start(jnp.append(jnp.zeros(1), joints), free_joint(chest, 0.0)[None], unplaced)


def _drawer(view: View) -> Frame:
    chest = placing.fixture(view, 0)
    way = view.joints[0] * jnp.array([0.0, 1.0, 0.0])
    return Frame(out_of(chest, way), chest.rotation)


def _boxes(view: View) -> Boxes:
    chest = box(placing.fixture(view, 0), (0.0, 0.0, CHEST_HALF[2]), CHEST_HALF)
    front = box(_drawer(view), FRONT_CENTER, FRONT_HALF)
    return stacked([chest, front, *placing.frees(view.joints[1:], (ITEM_HALF,))])


def _progress(view: View, things: Boxes) -> StageProgress:
    drawer, travel = _drawer(view), view.joints[0]
    (low_x, low_y), (high_x, high_y) = INSIDE
    spot = Spot(drawer, (low_x, low_y, FLOOR), (high_x, high_y, RIM), (0.0, 0.03, 0.28))
    item = placing.picked(things, 2, 1)
    local = into(placing.fixture(view, 0), item.position[0])
    ground = jnp.where(local[1] < CHEST_HALF[1], TOP, 0.0)
    put = placing.put(view, item, placing.speeds(view.rates[1:]), spot, ground=ground)
    is_open = travel > OPEN
    gap = out_of(drawer, jnp.array(BAR) - jnp.array([0.0, 0.03, 0.0]))
    pulled = jnp.clip(travel / _ENOUGH, 0.0, 1.0)
    pulling = 0.3 * closeness(view.hand.position, gap) + 0.7 * pulled
    within = jnp.where(is_open, put.within, pulling)
    return StageProgress(jnp.append(is_open, put.done), within, put.finished & is_open)


def stages(things: tuple[str, ...], *, half_extent: float) -> Stages:
    """The stages as seen in a picture, where an item before a shut drawer looks to be in it."""
    chest, drawer, item = range(placing.FIRST, len(things))
    pulled = placing.placed("drawer open", drawer, chest, _OPEN, _WIDE, others=(drawer,))
    put = placing.placed(
        "item in", item, drawer, _INSIDE, _CLEARLY, others=(item,), after=(pulled.name,)
    )
    return Stages(
        (pulled, put), movable=(drawer, item), robots=placing.ROBOTS, half_extent=half_extent,
        score=placing.share_in_order, possible=placing.on_rail(drawer, chest, _RAIL, _ASIDE),
    )  # fmt: skip


TASK = Task(
    things=("chest", "drawer", "item"), stages=("drawer open", "item in"), scene=_scene(),
    home=HOME, start=_start, boxes=_boxes, progress=_progress, episode_length=200,
    by_boxes=stages, tilt=_TILT,
    layout=Layout(
        (0,), (ITEM_HALF,),
        (Space(0, *[CHEST_HALF[:2]] * 2, TOP), Space(0, *_TROUGH, FLOOR, slide=0)),
        (Rail(1, 0.0, TRAVEL, None),),
    ),
    colours=((0.62, 0.42, 0.24), (0.78, 0.6, 0.38), (0.45, 0.7, 0.85)),
)  # fmt: skip
ENTRY = Entry(TASK, SCRIPT)
