"""A scripted expert for umbrella out, and the ways in which its demonstrations fail.

"success"          the umbrella is taken at its crook, lifted out and held aside
"lifted halfway"   it is lifted a little, and held in the stand
"let go"           it is lifted halfway and let go
"never gripped"    the hand goes up without having closed
"beside it"        the hand closes beside the crook, and goes up without the umbrella
"pushed over"      closed fingers push it to another wall of the stand
"stops early"      a success that breaks off at some moment
"""

import numpy as np
from gril_jax.envs.tabletop import moves
from gril_jax.envs.tabletop.hand import OPEN, Hand
from gril_jax.envs.tabletop.recorded import Run
from gril_jax.envs.tabletop.script import EARLY, Script

from . import model

KINDS = ("success", "lifted halfway", "let go", "never gripped", "beside it", "pushed over",
         EARLY)  # fmt: skip
_UMBRELLA = 9  # the first position of its joint
_ALOFT = 0.03  # metres: of the tip of an umbrella that has been lifted


def _crook(hand: Hand) -> tuple[np.ndarray, float]:
    """The middle of the crook in the world, and the fingers' turn for it."""
    pose = moves.pose(hand, _UMBRELLA)
    w, x, y, z = pose[3:]
    axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    return pose[:3] + model.GRIP[2] * axis, moves.folded(moves.yaw_of(pose[3:]))


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
    # Where it is held does not matter, and films should show that.
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
