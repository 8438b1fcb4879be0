"""RLBench's take_umbrella_out_of_umbrella_stand: grasp the umbrella and lift it out.

Things: stand, umbrella, which leans in it; its origin is its tip, its axis z, and a block takes the
place of its crook.
Stage: the umbrella out: all of it above the rim of the stand, and held by both fingertips. Success:
so in 5 frames in a row. Progress: reaching for the crook, holding it, the height of the tip.
"""

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.panda.kinematics import Frame, into, out_of, rotation
from gril_jax.envs.panda.model import PADS, TIPS
from gril_jax.envs.stages import Stages
from gril_jax.envs.tabletop import HOME, moves, physics, placing
from gril_jax.envs.tabletop.boxes import Boxes, box, lowest, stacked
from gril_jax.envs.tabletop.demonstrations import Entry
from gril_jax.envs.tabletop.moves import OPEN, Hand
from gril_jax.envs.tabletop.physics import TABLE, Additions
from gril_jax.envs.tabletop.placing import Area
from gril_jax.envs.tabletop.recorded import EARLY, Run, Script
from gril_jax.envs.tabletop.resting import Layout, Space
from gril_jax.envs.tabletop.reward import StageProgress, closeness
from gril_jax.envs.tabletop.start import YAW, Start, free_joint, group
from gril_jax.envs.tabletop.task import Task, View
from jaxtyping import PRNGKeyArray

RIM = 0.2  # height of the stand
INSIDE = (0.041, 0.041)  # half its space
STAND_HALF = physics.outside(INSIDE, RIM)
LENGTH = 0.265  # of the umbrella
UMBRELLA_HALF = (0.013, 0.013, LENGTH / 2)
GRIP = (0.0, 0.0, 0.235)  # the middle of the block, from the tip
TIP, LEAN = -0.028, 0.2618  # the tip's place from the stand's middle; rad, towards the other wall

_WALLS = physics.walls("stand", INSIDE, RIM)


def _rod(name: str, radius: float, low: float, high: float, mass: float) -> str:
    ends = f'fromto="0 0 {low + radius} 0 0 {high - radius}"'
    return f'<geom name="{name}" type="capsule" size="{radius}" {ends} mass="{mass}"/>'


def _scene() -> Additions:
    """The scene; the joint after the arm's is the umbrella's free one."""
    umbrella = physics.loose(
        "umbrella", _rod("canopy", 0.013, 0.0, 0.178, 0.1), _rod("shaft", 0.005, 0.15, 0.215, 0.01),
        physics.box("crook", GRIP, (0.012, 0.012, 0.03), 0.03),
        physics.box("", (0.0, 0.0, 0.165), (0.013, 0.013, 0.008)),  # the strap, painted alone
    )  # fmt: skip
    stand = physics.fixed("stand", *(physics.box(name, *shape) for name, shape in _WALLS.items()))
    pairs = [("canopy", TABLE), ("crook", TABLE), *(("crook", pad) for pad in PADS)]
    pairs += [(part, wall) for part in ("canopy", "shaft", "crook") for wall in _WALLS]
    pairs += [(tip, other) for tip in TIPS for other in (TABLE, *_WALLS, "canopy")]
    return Additions(stand + umbrella, tuple(pairs))


KINDS = (
    "success",  # the umbrella is taken at its crook, lifted out and held aside
    "lifted halfway",  # it is lifted a little, and held in the stand
    "let go",  # it is lifted halfway and let go
    "never gripped",  # the hand goes up without having closed
    "beside it",  # the hand closes beside the crook, and goes up without the umbrella
    "pushed over",  # closed fingers push it to another wall of the stand
    EARLY,
)
_UMBRELLA = 9  # the first position of its joint
_ALOFT = 0.03  # metres: of the tip of an umbrella that has been lifted


def _crook(hand: Hand) -> tuple[np.ndarray, float]:
    """The middle of the crook in the world, and the fingers' turn for it."""
    pose = moves.pose(hand, _UMBRELLA)
    w, x, y, z = pose[3:]
    axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    return pose[:3] + GRIP[2] * axis, moves.folded(moves.yaw_of(pose[3:]))


def _follow(hand: Hand, rng: np.random.Generator, kind: str) -> None:
    """Plays the script of a kind, from its beginning to its end."""
    pace = moves.draw_pace(rng, (0.46, 0.54))
    hand.rest(int(rng.integers(0, 10)))
    above = rng.uniform(0.36, 0.42)
    place, yaw = _crook(hand)
    side = np.array([-np.sin(yaw), np.cos(yaw), 0.0])  # along which the fingers open
    if kind == "beside it":
        place = place + rng.choice([-1, 1]) * rng.uniform(0.06, 0.08) * side
    if kind == "pushed over":
        way = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        high, deep = place + 0.06 * way, place + 0.04 * way - [0, 0, 0.02]
        hand.move(high + [0, 0, 0.1], speed=pace.speed, yaw=yaw)
        moves.stroke(hand, (deep, deep - 0.12 * way), speed=0.15, yaw=yaw)
        hand.move((*hand.place[:2], pace.arc), speed=pace.speed)
        return hand.rest(int(rng.integers(10, 40)))
    depth = place[2] + rng.uniform(-0.012, 0.008)
    hand.grip = OPEN
    hand.move((*place[:2], above), speed=pace.speed, yaw=yaw)
    hand.move((*place[:2], depth), speed=0.2)
    hand.rest(int(rng.integers(2, 8)))
    if kind != "never gripped":
        hand.close()
    if kind in ("lifted halfway", "let go"):
        hand.move((*place[:2], depth + rng.uniform(0.07, 0.14)), speed=pace.speed)
        hand.rest(int(rng.integers(10, 40)))
        if kind == "let go":
            hand.open()
            hand.move((*place[:2], pace.arc), speed=pace.speed)
        return hand.rest(10)
    hand.move((*place[:2], pace.arc), speed=pace.speed)
    # Where it is held does not matter, and videos should show that.
    anywhere = (rng.uniform(0.42, 0.58), rng.uniform(-0.25, 0.2), pace.arc)
    hand.move(anywhere, speed=pace.speed)
    return hand.rest(int(rng.integers(5, 20)))


def _shows(run: Run) -> bool:
    """True if positions alone show that an episode without success is of its kind of failure."""
    pose = run.qpos[:, _UMBRELLA : _UMBRELLA + 7]
    tip, lean = pose[:, 2], (run.boxes.position[:, -1] - pose[:, :3])[:, :2]
    leant = np.linalg.norm(lean[-1] - lean[0])
    lifted = tip.max() > _ALOFT * (1 + (run.kind == "pushed over"))  # a push lifts it a little
    hand = run.boxes.position[:, 2]
    off = np.linalg.norm(hand[:, :2] - run.boxes.position[:, -1, :2], axis=1)[hand[:, 2].argmin()]
    marks = {
        "lifted halfway": tip[-1] > _ALOFT,
        "let go": lifted and tip[-1] < _ALOFT,
        "never gripped": not lifted and off < 0.06,
        "beside it": not lifted and off > 0.04,
        "pushed over": not lifted and leant > 0.02,
    }
    return bool(marks[run.kind])


SCRIPT = Script(KINDS, _follow, _shows)

STAND = (0.55, -0.10, 0.0)  # x, y, yaw
_LEAST = 0.02  # metres of it that can always be seen
_RISE = 0.0006  # metres: the tip's height at the start, as it is round
# The umbrella's middle from the stand's, in its sizes: out, and clearly so. How far aside it is
# held does not matter.
_OUT, _CLEARLY = Area((-5.0, 0.8), (7.0, 5.0)), Area((-0.3, 1.0), (1.5, 1.4))
# How its box grows while it is drawn out: the middle's height, as above, and width and height as
# shares of those at the start. Means over 128 starts.
_GROWTH = (
    (0.341, 1.0, 1.0), (0.459, 1.109, 1.552), (0.583, 1.222, 2.142), (0.711, 1.334, 2.779),
    (0.846, 1.447, 3.452), (1.059, 1.492, 3.673), (1.284, 1.54, 3.911),
)  # fmt: skip
_BESIDE = 0.6  # in widths of the stand: an umbrella farther aside is not in it


def _start(key: PRNGKeyArray, share: float) -> Start:
    key_group, key_lean = jax.random.split(key)
    stand = group(key_group, jnp.array([STAND]), share=share)
    yaw = stand[0, 2] + share * YAW * jax.random.uniform(key_lean, minval=-1.0)
    tip = stand[0, :2] + TIP * jnp.stack([jnp.cos(yaw), jnp.sin(yaw)])
    half, lean = yaw / 2, LEAN / 2
    (c, s), (a, b) = (jnp.cos(half), jnp.sin(half)), (jnp.cos(lean), jnp.sin(lean))
    turn = jnp.stack([c * a, -s * b, c * b, s * a])  # the lean about y, then the yaw about z
    joints = jnp.concatenate([tip, jnp.array([_RISE]), turn])
    return Start(joints, free_joint(stand, 0.0)[None], jnp.zeros((), bool))


def _umbrella(view: View) -> Frame:
    return Frame(view.joints[:3], rotation(view.joints[3:]))


def _boxes(view: View) -> Boxes:
    stand = box(placing.fixture(view, 0), (0.0, 0.0, RIM / 2), STAND_HALF)
    umbrella = box(_umbrella(view), (0.0, 0.0, LENGTH / 2), UMBRELLA_HALF)
    return stacked([stand, umbrella])


def _seen(view: View, things: Boxes) -> Boxes:
    """The boxes, of an umbrella that is in the stand the part above its rim alone."""
    frame, stand = _umbrella(view), placing.fixture(view, 0)
    within = (jnp.abs(into(stand, frame.position))[:2] < jnp.array(INSIDE)).all()
    upright = jnp.maximum(frame.rotation[2, 2], 0.1)
    hidden = jnp.clip((RIM - frame.position[2]) / upright, 0.0, LENGTH - _LEAST)
    hidden = jnp.where(within, hidden, 0.0)
    x, y, _ = UMBRELLA_HALF
    middle = jnp.zeros(3).at[2].set((hidden + LENGTH) / 2)
    part = box(frame, middle, jnp.stack([x, y, (LENGTH - hidden) / 2]))
    return Boxes(*(whole.at[1].set(own) for whole, own in zip(things, part, strict=True)))


def _progress(view: View, things: Boxes) -> StageProgress:
    umbrella = Boxes(*(x[1] for x in things))
    held, height = placing.held(view, umbrella), lowest(umbrella)
    out = held & (height > RIM)
    grip = out_of(_umbrella(view), jnp.array(GRIP))
    lift = jnp.clip(height / (1.1 * RIM), 0.0, 1.0)
    within = 0.3 * closeness(view.hand.position, grip) + held * (0.2 + 0.5 * lift)
    return StageProgress(out[None], within, out)


def stages(things: tuple[str, ...], *, half_extent: float) -> Stages:
    """The stage as seen in a picture, which shows the height and not the grip."""
    stand, umbrella = range(placing.FIRST, len(things))
    out = placing.placed("umbrella out", umbrella, stand, _OUT, _CLEARLY, others=(umbrella,))

    def sizes(center, size):
        x, y = placing.relative(umbrella, stand, center, size)
        height, *shares = jnp.array(_GROWTH).T
        beside = jnp.abs(x) > _BESIDE
        grown = [jnp.interp(jnp.where(beside, height[-1], y), height, share) for share in shares]
        return size.at[umbrella].multiply(jnp.stack(grown))

    return Stages(
        (out,), movable=(umbrella,), robots=placing.ROBOTS, half_extent=half_extent,
        score=placing.share_that_holds, sizes=sizes,
    )  # fmt: skip


TASK = Task(
    things=("stand", "umbrella"), stages=("umbrella out",), scene=_scene(), home=HOME,
    start=_start, boxes=_boxes, progress=_progress, episode_length=100, by_boxes=stages,
    seen=_seen,
    layout=Layout(
        (0,), (UMBRELLA_HALF,), (Space(0, INSIDE, STAND_HALF[:2]),),
        middle=LENGTH / 2, grip=GRIP[2] - LENGTH / 2,
    ),
    colours=((0.3, 0.31, 0.35), (0.2, 0.36, 0.68)),
)  # fmt: skip
ENTRY = Entry(TASK, SCRIPT)
