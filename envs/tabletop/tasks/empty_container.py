"""RLBench's empty_container: bring three blocks from the tray into the bin.

Things: tray, bin, other bin, block A (the nearest to the bin), block B, block C; blocks take the
place of RLBench's random solids, and the other bin is painted alone.
Stages: block A in, block B in, block C in: the centre inside the bin's walls and below 0.06 m, and
released; in any order. Success: all are in, slower than 0.05 m/s, in 5 frames in a row.
"""

import jax
import jax.numpy as jnp
import numpy as np
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
from gril_jax.envs.tabletop.start import NOTHING, Footprint, Start, free_joint, group, place
from gril_jax.envs.tabletop.task import Task, View
from jaxtyping import PRNGKeyArray

HEIGHT = 0.05  # of tray and bins
TRAY, BIN = (0.136, 0.136), (0.096, 0.0585)  # half their spaces
BLOCKS = ((0.035, 0.018, 0.0125), (0.03, 0.02, 0.015), (0.04, 0.015, 0.0125))  # half extents

_WALLS = physics.walls("tray", TRAY, HEIGHT) | physics.walls("bin", BIN, HEIGHT)
_NAMES = ("block_a", "block_b", "block_c")


def _outside(space: tuple[float, float]) -> tuple[float, float, float]:
    """Half extents of the box around a tray or bin of that space."""
    return physics.outside(space, HEIGHT)


def _standing(name: str, walls: dict[str, tuple]) -> str:
    return physics.fixed(name, *(physics.box(wall, *shape) for wall, shape in walls.items()))


def _scene() -> Additions:
    """The scene; joints after the arm's are one free joint for each block."""
    standing = _standing("tray", physics.walls("tray", TRAY, HEIGHT))
    standing += _standing("bin", physics.walls("bin", BIN, HEIGHT))
    standing += _standing("other_bin", physics.walls("other_bin", BIN, HEIGHT))
    blocks = "".join(
        physics.loose(name, physics.box(name, (0, 0, 0), half, 0.1))
        for name, half in zip(_NAMES, BLOCKS, strict=True)
    )
    pairs = [(block, other) for block in _NAMES for other in (TABLE, *PADS, *_WALLS)]
    pairs += [(a, b) for i, a in enumerate(_NAMES) for b in _NAMES[i + 1 :]]
    pairs += [(tip, other) for tip in TIPS for other in (TABLE, *_WALLS)]
    return Additions(standing + blocks, tuple(pairs))


KINDS = (
    "success",  # all three blocks, the one nearest to the bin first
    "two blocks",  # two of them, then nothing
    "one block",  # one of them, then nothing
    "wrong bin",  # one of them is put into the other bin
    "block beside",  # one of them is let go between tray and bin
    "back in the tray",  # one of them is lifted and let go over the tray
    EARLY,
)
_FIRST = 9  # the first position after the arm's
_TRAY, _INTO, _OTHER = range(3)  # of the fixtures
_ABOVE, _ALOFT = 0.15, 0.1  # metres: the hand over a block; a block that is carried
_DEPTH = 0.018
_ALONG = (-0.06, 0.0, 0.06)  # the bin's x at which blocks are let go, across it: any at any


def _take(hand: Hand, rng: np.random.Generator, pace: Pace, block: int) -> None:
    """Takes a block, and tries again if it slips."""
    aside, joint = rng.uniform(-0.008, 0.008), _FIRST + 7 * block
    moves.take(hand, joint, pace, depth=_DEPTH, above=_ABOVE, aloft=_ALOFT, aside=aside)


def _let_go(hand: Hand, pace: Pace, to: int, *where: float) -> None:
    """Lets go at a place in the frame of a fixture, the block across it."""
    base = hand.fixtures[to]
    yaw = moves.yaw_of(base[3:]) + np.pi / 2
    moves.carry(hand, moves.out_of(base, where), pace, yaw=yaw)
    moves.release(hand, pace)


def _follow(hand: Hand, rng: np.random.Generator, kind: str) -> None:
    """Plays the script of a kind, from its beginning to its end."""
    pace = moves.draw_pace(rng, (0.19, 0.28))
    astray = kind in ("wrong bin", "block beside", "back in the tray")
    missed = int(rng.integers(0, 3)) if astray else None
    along = rng.permutation(_ALONG)
    count = {"two blocks": 2, "one block": 1}.get(kind, 3)
    for block in range(count):
        hand.rest(int(rng.integers(0, 8)) * int(rng.random() < 0.4))
        _take(hand, rng, pace, block)
        height = rng.uniform(0.065, 0.08)
        spot = (along[block] + rng.uniform(-0.008, 0.008), rng.uniform(-0.008, 0.008), height)
        if block != missed:
            _let_go(hand, pace, _INTO, *spot)
        elif kind == "wrong bin":
            _let_go(hand, pace, _OTHER, *spot)
        elif kind == "block beside":
            _let_go(hand, pace, _INTO, rng.uniform(0.15, 0.2), rng.uniform(-0.05, 0.05), 0.05)
        else:
            _let_go(hand, pace, _TRAY, *rng.uniform(-0.05, 0.05, 2), 0.1)
    if count < 3:
        moves.wander(hand, rng, pace)


def _within(run: Run, fixture: int, half: tuple[float, float]) -> np.ndarray:
    """True for the blocks that end within the walls of a fixture."""
    x, y, z = run.fixtures[fixture, :3]
    turn = moves.yaw_of(run.fixtures[fixture, 3:])
    c, s = np.cos(turn), np.sin(turn)
    away = run.boxes.position[-1, -3:] - [x, y, z]
    local = np.stack([c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]], axis=1)
    return (np.abs(local) < half).all(axis=1) & (away[:, 2] < _ALOFT)


def _shows(run: Run) -> bool:
    """True if positions alone show that an episode without success is of its kind of failure."""
    lifted = run.boxes.position[:, -3:, 2].max(axis=0) > _ALOFT
    binned, other = _within(run, _INTO, BIN), _within(run, _OTHER, BIN)
    tray = _within(run, _TRAY, TRAY)
    marks = {
        "two blocks": binned.sum() == 2 and lifted.sum() == 2,
        "one block": binned.sum() == 1 and lifted.sum() == 1,
        "wrong bin": binned.sum() == 2 and other.sum() == 1,
        "block beside": binned.sum() == 2 and not (other | tray).any(),
        "back in the tray": lifted.all() and binned.sum() == 2 and (tray & lifted).any(),
    }
    return bool(marks[run.kind])


SCRIPT = Script(KINDS, _follow, _shows)

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
_SPACES = tuple(Space(i, space, _outside(space)[:2]) for i, space in enumerate((TRAY, BIN)))


def _start(key: PRNGKeyArray, share: float) -> Start:
    key_group, key_blocks = jax.random.split(key)
    places = group(key_group, jnp.array(LAYOUT), share=share)
    halves = jnp.array([half[:2] for half in BLOCKS])
    blocks, unplaced = place(
        key_blocks, Footprint(places[3:], halves), NOTHING, share=_SHARE * share
    )
    joints = free_joint(blocks, 0.0).reshape(3, 7).at[:, 2].set(jnp.array(BLOCKS)[:, 2])
    return Start(joints.reshape(-1), free_joint(places[:3], 0.0).reshape(3, 7), unplaced)


def _boxes(view: View) -> Boxes:
    spaces = (TRAY, BIN, BIN)
    middle = (0.0, 0.0, HEIGHT / 2)
    standing = [
        box(placing.fixture(view, i), middle, _outside(space)) for i, space in enumerate(spaces)
    ]
    return stacked([*standing, *placing.frees(view.joints, BLOCKS)])


def _progress(view: View, things: Boxes) -> StageProgress:
    x, y = BIN
    spot = Spot(placing.fixture(view, 1), (-x, -y, -1.0), (x, y, _BELOW), (0.0, 0.0, 0.1))
    return placing.put(view, placing.picked(things, 3, 3), placing.speeds(view.rates), spot)


def stages(things: tuple[str, ...], *, half_extent: float) -> Stages:
    """The stages as seen in a picture."""
    bin_, *blocks = (placing.FIRST + i for i in (1, 3, 4, 5))
    return Stages(
        tuple(
            placing.placed(f"{things[i]} in", i, bin_, _INSIDE, _CLEARLY, others=tuple(blocks))
            for i in blocks
        ),
        movable=tuple(blocks), robots=placing.ROBOTS, half_extent=half_extent,
        score=placing.share_that_holds,
    )  # fmt: skip


TASK = Task(
    things=("tray", "bin", "other bin", "block A", "block B", "block C"),
    stages=("block A in", "block B in", "block C in"), scene=_scene(), home=HOME,
    start=_start, boxes=_boxes, progress=_progress, episode_length=300, by_boxes=stages,
    max_contacts=32, layout=Layout((0, 1, 2), BLOCKS, _SPACES),
    colours=((0.6, 0.6, 0.62), (0.75, 0.22, 0.2), (0.2, 0.35, 0.7), (0.3, 0.3, 0.32),
             (0.42, 0.44, 0.36), (0.36, 0.3, 0.4)),
)  # fmt: skip
ENTRY = Entry(TASK, SCRIPT)
