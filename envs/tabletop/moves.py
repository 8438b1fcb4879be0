"""Moves of a hand over the table: grasp, carry, release, push, and strokes with closed fingers.

Places are in the world; lengths are metres, speeds m/s, pauses control steps.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .hand import CLOSED, OPEN, Hand

_DOWNWARDS = 0.25  # m/s at most, on the way down to something


class Pace(NamedTuple):
    """How a person carries things."""

    speed: float
    arc: float  # height of the tool centre point while something is carried
    detour: tuple[float, float]  # of the middle of the way, x and y


def draw_pace(rng: np.random.Generator, arc: tuple[float, float]) -> Pace:
    """Samples a pace whose arc is within a range."""
    speed = rng.uniform(0.2, 0.4)
    return Pace(speed, rng.uniform(*arc), (rng.uniform(-0.05, 0.05), rng.uniform(-0.03, 0.03)))


def yaw_of(quaternion: Float[np.ndarray, "4"]) -> float:
    """The yaw of a quaternion, rad."""
    w, x, y, z = quaternion
    return float(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))


def out_of(pose: Float[np.ndarray, "7"], point) -> Float[np.ndarray, "3"]:
    """Maps a point given in a frame that is turned by a yaw alone to the world."""
    yaw, (x, y, z) = yaw_of(pose[3:]), point
    c, s = np.cos(yaw), np.sin(yaw)
    return pose[:3] + np.array([c * x - s * y, s * x + c * y, z])


def pose(hand: Hand, joint: int) -> Float[np.ndarray, "7"]:
    """The present pose of a free thing whose first position is number `joint`."""
    return hand.qpos[joint : joint + 7].copy()


def folded(yaw: float) -> float:
    """The fingers' turn for a thing of this yaw: at most a quarter turn."""
    return float((yaw + np.pi / 2) % np.pi - np.pi / 2)


def holds(hand: Hand, joint: int, *, above: float, within: float = 0.1) -> bool:
    """True if a free thing's centre is above a height, and with the hand."""
    place = pose(hand, joint)[:3]
    return bool(place[2] > above and np.linalg.norm(place - hand.place) < within)


def grasp(
    hand: Hand, spot, pace: Pace, *, depth: float, above: float, yaw: float, opening: float = OPEN
) -> None:
    """Goes over a spot (x, y), down to `depth`, closes there, and lifts to the pace's arc.

    From below `above` it first goes up; `opening` is the gripper's action on the way down.
    """
    hand.grip = opening
    if hand.place[2] < above:
        hand.move((*hand.place[:2], pace.arc), speed=pace.speed)
    hand.move((*spot, above), speed=pace.speed, yaw=yaw)
    hand.move((*spot, depth), speed=min(_DOWNWARDS, pace.speed))
    hand.rest(3)
    hand.close()
    hand.move((*spot, pace.arc), speed=pace.speed)


def take(
    hand: Hand, joint: int, pace: Pace, *, depth: float, above: float, aloft: float,
    aside: float, turned: bool = True,
) -> None:  # fmt: skip
    """Takes a free thing and lifts it beyond a height of `aloft`; tries again once if it slips.

    It is taken `aside` of its middle along the fingers' turn: its own, or the hand's if it is not
    `turned`.
    """
    for _ in range(2):
        place = pose(hand, joint)
        turn = folded(yaw_of(place[3:])) if turned else hand.yaw
        spot = place[:2] + aside * np.array([np.cos(turn), np.sin(turn)])
        grasp(hand, spot, pace, depth=depth, above=above, yaw=turn)
        if holds(hand, joint, above=aloft):
            return


def put_back(hand: Hand, pace: Pace, *, depth: float, up: float) -> None:
    """Puts down what is held where it was taken, and lets go."""
    here = hand.place.copy()
    hand.move((*here[:2], depth + 0.03), speed=pace.speed)
    hand.move((*here[:2], depth + 0.005), speed=0.15)
    hand.open()
    hand.move((*here[:2], up), speed=pace.speed)


def carry(hand: Hand, goal, pace: Pace, *, yaw: float) -> None:
    """Moves at the pace's arc over a place, and down to it."""
    above = np.array([*goal[:2], pace.arc])
    middle = (hand.place + above) / 2 + [*pace.detour, 0.02]
    hand.move(middle, speed=pace.speed)
    hand.move(above, speed=pace.speed, yaw=yaw)
    hand.move(goal, speed=min(_DOWNWARDS, pace.speed))
    hand.rest(3)


def release(hand: Hand, pace: Pace, *, pause: int = 0) -> None:
    """Opens the gripper and moves up."""
    hand.rest(pause)
    hand.open()
    hand.move((*hand.place[:2], pace.arc), speed=pace.speed)


def stroke(hand: Hand, points, *, speed: float, yaw: float) -> None:
    """Moves through points with closed fingers: pulls and pushes what is in their way."""
    hand.grip = CLOSED
    for point in points:
        hand.move(point, speed=speed, yaw=yaw)


def knock(
    hand: Hand, place, pace: Pace, way, *, height: float = 0.03, reach: float = 0.12,
    grip: float = CLOSED, yaw: float | None = None,
) -> None:  # fmt: skip
    """Strikes what is at a place (x, y) along a direction (x, y), from 13 cm before it."""
    way = np.asarray(way) / np.linalg.norm(way)
    hand.grip = grip
    behind = place[:2] - 0.13 * way
    hand.move((*behind, pace.arc), speed=pace.speed, yaw=yaw)
    hand.move((*behind, height), speed=0.3)
    hand.move((*(place[:2] + reach * way), height), speed=0.45)
    hand.move((*hand.place[:2], pace.arc), speed=pace.speed)


def wander(hand: Hand, rng: np.random.Generator, pace: Pace) -> None:
    """Goes anywhere above the table and rests there, its grip as it is."""
    goal = (rng.uniform(0.4, 0.55), rng.uniform(-0.15, 0.25), rng.uniform(0.3, 0.45))
    hand.move(goal, speed=pace.speed)
    hand.rest(int(rng.integers(5, 40)))
