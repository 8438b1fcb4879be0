"""RLBench's put_rubbish_in_bin: throw the rubbish into the bin, and no tomato.

Things: bin (square, as MJX has no hollow cylinder), rubbish, in one of three places in a row, and
tomato A, tomato B in the others, spheres whose joints are damped, so that they roll to a stop.
Stage: the rubbish in: its centre inside the walls and below 0.10 m, and released. Success: it is in
and slower than 0.05 m/s, with no tomato in the bin, in 5 frames in a row.
"""

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.panda.kinematics import Frame
from gril_jax.envs.panda.model import PADS, TIPS
from gril_jax.envs.stages import Stages
from gril_jax.envs.tabletop import HOME, moves, physics, placing
from gril_jax.envs.tabletop.boxes import Boxes, box, stacked
from gril_jax.envs.tabletop.demonstrations import Entry
from gril_jax.envs.tabletop.moves import Hand, Pace
from gril_jax.envs.tabletop.physics import TABLE, Additions
from gril_jax.envs.tabletop.placing import Area, Spot
from gril_jax.envs.tabletop.recorded import EARLY, Run, Script
from gril_jax.envs.tabletop.resting import Layout, Space
from gril_jax.envs.tabletop.reward import StageProgress
from gril_jax.envs.tabletop.start import Footprint, Start, free_joint, group, place
from gril_jax.envs.tabletop.task import Task, View
from jaxtyping import PRNGKeyArray

HEIGHT = 0.19  # of the bin
INSIDE = (0.081, 0.081)  # half its space
BIN_HALF = physics.outside(INSIDE, HEIGHT)
RUBBISH_HALF = (0.025, 0.02, 0.018)
RADIUS = 0.03  # of a tomato

_WALLS = physics.walls("bin", INSIDE, HEIGHT)
_SPHERES = ("tomato_a", "tomato_b")


def _pairs() -> tuple[tuple[str, str], ...]:
    things = ("rubbish", *_SPHERES)
    pairs = [(thing, other) for thing in things for other in (TABLE, *PADS, *_WALLS)]
    pairs += [("rubbish", tomato) for tomato in _SPHERES]
    return (*pairs, _SPHERES, *((tip, other) for tip in TIPS for other in (TABLE, *_WALLS)))


def _scene() -> Additions:
    """The scene; joints after the arm's are one free joint each for rubbish and tomatoes."""
    shapes = (physics.box(name, *shape, more=physics.HIDDEN) for name, shape in _WALLS.items())
    basket = physics.fixed("bin", *shapes, physics.wires(INSIDE, HEIGHT))
    rubbish = physics.loose("rubbish", physics.box("rubbish", (0, 0, 0), RUBBISH_HALF, 0.05))
    tomatoes = "".join(
        physics.loose(
            name, f'<geom name="{name}" size="{RADIUS}" mass="0.1"/>', joint='damping="3e-4"'
        )
        for name in _SPHERES
    )
    return Additions(basket + rubbish + tomatoes, _pairs())


KINDS = (
    "success",  # the rubbish is taken and let go above the bin
    "tomato instead",  # a tomato is thrown in
    "tomato too",  # a tomato, then the rubbish
    "rubbish beside",  # the rubbish is let go beside the bin
    "never gripped",  # the hand closes above the rubbish and goes to the bin without it
    "held above",  # the rubbish is held over the bin and not let go
    "knocked away",  # the rubbish is struck out of its place
    EARLY,
)
_FIRST = 9  # the first position after the arm's
_ABOVE = 0.16  # height from which the hand goes down to something
_TAKE = (0.02, 0.03)  # height of the tool centre point that holds rubbish, or a tomato
_AMID = 0.04  # metres: how far from the middle of the bin something is let go, along each axis
_ALOFT, _FAR = 0.1, 0.05  # metres: of what is carried, and of what was struck
_RUBBISH, _TOMATOES = 4, (5, 6)  # among the environment's classes


def _take(hand: Hand, rng: np.random.Generator, pace: Pace, thing: int) -> None:
    """Takes the rubbish (0) or a tomato, and tries again if it slips."""
    moves.take(
        hand, _FIRST + 7 * thing, pace, depth=_TAKE[thing > 0], above=_ABOVE, aloft=_ALOFT,
        aside=rng.uniform(-0.008, 0.008), turned=not thing,
    )  # fmt: skip


def _bring(hand: Hand, rng: np.random.Generator, pace: Pace, *, aside=(0.0, 0.0)) -> None:
    """Carries over the bin, or aside of its middle."""
    spot = rng.uniform(-_AMID, _AMID, 2) + aside
    height = rng.uniform(0.24, 0.28) if not any(aside) else 0.08
    bin_ = hand.fixtures[0]
    moves.carry(hand, moves.out_of(bin_, (*spot, height)), pace, yaw=moves.yaw_of(bin_[3:]))


def _follow(hand: Hand, rng: np.random.Generator, kind: str) -> None:
    """Plays the script of a kind, from its beginning to its end."""
    pace = moves.draw_pace(rng, (0.29, 0.38))
    hand.rest(int(rng.integers(0, 10)))
    if kind == "knocked away":
        angle = rng.uniform(-0.4, 0.6)  # away from the robot
        place = moves.pose(hand, _FIRST)
        moves.knock(hand, place, pace, (np.cos(angle), np.sin(angle)), reach=0.1)
        return moves.wander(hand, rng, pace)
    if kind in ("tomato instead", "tomato too"):
        _take(hand, rng, pace, int(rng.integers(1, 3)))
        _bring(hand, rng, pace)
        moves.release(hand, pace)
    if kind == "never gripped":
        spot = moves.pose(hand, _FIRST)[:2]
        moves.grasp(hand, spot, pace, depth=rng.uniform(0.06, 0.09), above=_ABOVE, yaw=hand.yaw)
    elif kind != "tomato instead":
        _take(hand, rng, pace, 0)
    if kind == "rubbish beside":
        _bring(hand, rng, pace, aside=(rng.uniform(-0.1, -0.02), 0.17))
    elif kind != "tomato instead":
        _bring(hand, rng, pace)
    if kind in ("held above", "never gripped"):
        return hand.rest(int(rng.integers(20, 60)))
    return moves.release(hand, pace, pause=int(rng.integers(0, 6)))


def _shows(run: Run) -> bool:
    """True if positions alone show that an episode without success is of its kind of failure."""
    places = run.boxes.position
    rubbish, tomatoes = places[:, _RUBBISH], places[:, _TOMATOES, :]
    away = np.abs(places[-1] - run.fixtures[0, :3])[:, :2].max(axis=1)
    inside = (away < INSIDE[0]) & (places[-1, :, 2] < HEIGHT / 2)
    lifted, binned = rubbish[:, 2].max() > _ALOFT, inside[list(_TOMATOES)].any()
    moved = np.linalg.norm(rubbish[-1] - rubbish[0])
    marks = {
        "tomato instead": binned and not lifted,
        "tomato too": binned and inside[_RUBBISH],
        "rubbish beside": lifted and not inside[_RUBBISH] and rubbish[-1, 2] < _ALOFT,
        "never gripped": not lifted and moved < _FAR and tomatoes[..., 2].max() < _ALOFT,
        "held above": rubbish[-1, 2] > _ALOFT and away[_RUBBISH] < INSIDE[0],
        "knocked away": not lifted and moved > _FAR,
    }
    return bool(marks[run.kind])


SCRIPT = Script(KINDS, _follow, _shows)

BIN = (0.56, -0.24, 0.0)  # x, y, yaw
PLACES = ((0.55, 0.12, 0.0), (0.55, -0.01, 0.0), (0.56, 0.25, 0.0))  # the first without jitter
_BELOW = 0.10  # metres: of the centre of what is in the bin
_HALVES = (RUBBISH_HALF, *[(RADIUS,) * 3] * 2)
# Where the middle of what lies in the bin is seen, and where it clearly is.
_INSIDE, _CLEARLY = Area((-0.32, -0.4), (0.32, 0.02)), Area((-0.1, -0.26), (0.2, -0.1))


def _start(key: PRNGKeyArray, share: float) -> Start:
    key_group, key_place, key_which = jax.random.split(key, 3)
    places = group(key_group, jnp.array((BIN, *PLACES)), share=share)
    which = jax.random.randint(key_which, (), 0, 3) * (share > 0)
    order = (jnp.arange(3) + which) % 3
    halves = jnp.array([half[:2] for half in _HALVES])
    standing = Footprint(places[:1], jnp.array([BIN_HALF[:2]]))
    things, unplaced = place(key_place, Footprint(places[1:][order], halves), standing, share=share)
    joints = free_joint(things, 0.0).reshape(3, 7).at[:, 2].set(jnp.array(_HALVES)[:, 2])
    return Start(joints.reshape(-1), free_joint(places[:1], 0.0)[None], unplaced)


def _boxes(view: View) -> Boxes:
    stands: Frame = placing.fixture(view, 0)
    basket = box(stands, (0.0, 0.0, HEIGHT / 2), BIN_HALF)
    return stacked([basket, *placing.frees(view.joints, _HALVES)])


def _progress(view: View, things: Boxes) -> StageProgress:
    x, y = INSIDE
    frame = placing.fixture(view, 0)
    spot = Spot(frame, (-x, -y, -1.0), (x, y, _BELOW), (0.0, 0.0, 0.28))
    put = placing.put(view, placing.picked(things, 1, 1), placing.speeds(view.rates)[:1], spot)
    spoilt = placing.at(spot, things.position[2:]).any()
    return put._replace(finished=put.finished & ~spoilt)


def stages(things: tuple[str, ...], *, half_extent: float) -> Stages:
    """The stage as seen in a picture; a tomato in the bin is a fault."""
    bin_, rubbish, *tomatoes = range(placing.FIRST, len(things))

    def inside(thing: int):
        name, others = f"{things[thing]} in", (rubbish, *tomatoes)
        return placing.placed(name, thing, bin_, _INSIDE, _CLEARLY, others=others)

    return Stages(
        (inside(rubbish),), movable=(rubbish, *tomatoes), robots=placing.ROBOTS,
        half_extent=half_extent, score=placing.share_without_faults,
        faults=tuple(inside(tomato) for tomato in tomatoes),
    )  # fmt: skip


TASK = Task(
    things=("bin", "rubbish", "tomato A", "tomato B"), stages=("rubbish in",),
    scene=_scene(), home=HOME, start=_start, boxes=_boxes, progress=_progress,
    episode_length=120, by_boxes=stages,
    layout=Layout((0,), _HALVES, (Space(0, INSIDE, BIN_HALF[:2]),)),
    colours=((0.45, 0.47, 0.5), (0.72, 0.72, 0.7), (0.8, 0.2, 0.15), (0.8, 0.3, 0.15)),
)  # fmt: skip
ENTRY = Entry(TASK, SCRIPT)
