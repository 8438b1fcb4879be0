"""The arm in C MuJoCo: a scripted episode of a table task, and the moves that it is made of.

Model, controller and control rate are the environment's. C MuJoCo needs no compilation and plays
one episode faster than MJX on a CPU plays many: 400 control steps in 0.13 s. Places are in the
world; lengths are metres, speeds m/s, pauses control steps.
"""

import functools
from typing import NamedTuple

import jax
import mujoco
import numpy as np
from gril_jax.envs.base import State
from gril_jax.envs.panda import kinematics
from gril_jax.envs.panda.kinematics import Frame
from jaxtyping import Float

from .environment import Tabletop

OPEN, CLOSED = 1.0, -1.0  # actions of the gripper
_PATIENCE = 12  # control steps without getting nearer, after which a move ends
_NEAR, _NEAR_TURN = 2e-3, 0.05  # metres, rad: there
_GAIN = 1e-3  # metres nearer that count
_TURN_WORTH = 0.1  # metres that a turn of 1 rad counts for


class Hand:
    """A running episode; the hand points down and holds `grip` and `yaw` between moves.

    It begins at a state of the environment's `reset`. After `limit` control steps nothing happens.
    """

    def __init__(self, env: Tabletop, start: State, *, limit: int = 1000):
        data = jax.tree.map(np.asarray, start.data)
        self.env, self.fixtures, self._limit = env, data.fixtures, limit
        self._model = env.physics.mj_model
        self._data = mujoco.MjData(self._model)
        self._data.qpos[:] = data.motion.qpos
        self._data.mocap_pos[:], self._data.mocap_quat[:] = np.split(data.fixtures, [3], axis=1)
        self._rest = np.asarray(env.task.home, np.float32)
        self._target = data.target
        self.place, self.yaw = _pose(_tool(self._target))
        self.grip = OPEN
        self.qpos = self._data.qpos  # a view: always the current joint positions
        self.positions: list[np.ndarray] = []
        self.velocities: list[np.ndarray] = []
        self.targets: list[np.ndarray] = []
        self._record()

    @property
    def steps(self) -> int:
        """Number of control steps so far."""
        return len(self.positions) - 1

    def _record(self) -> None:
        self.positions.append(self._data.qpos.astype(np.float32))
        self.velocities.append(self._data.qvel.astype(np.float32))
        self.targets.append(self._target)

    def act(self, action: Float[np.ndarray, "5"]) -> None:
        """Advances one control step of the environment."""
        if self.steps >= self._limit:
            return
        action = np.clip(action, -1, 1).astype(np.float32)
        arm = self._data.qpos[:7].astype(np.float32)
        dt, tilt = self.env.physics.dt, self.env.task.tilt
        aim, tool = _aim(self._target, arm, action, self._rest, dt=dt, tilt=tilt)
        self._target = np.asarray(aim)
        self.place, self.yaw = _pose(tool)
        self._data.ctrl[:] = self._target
        mujoco.mj_step(self._model, self._data, self.env.physics.substeps)
        self._record()

    def rest(self, steps: int) -> None:
        """Holds still."""
        for _ in range(steps):
            self.act(np.array([0, 0, 0, 0, self.grip], np.float32))

    def move(self, goal, *, speed: float, yaw: float | None = None) -> None:
        """Moves the tool centre point straight to x, y, z, or as near as the arm comes.

        The speed is in m/s; the yaw (rad) is reached on the way, None keeps the present one.
        """
        step = speed * self.env.physics.dt
        wanted = self.yaw if yaw is None else yaw
        nearest, since = np.inf, self.steps
        while self.steps < self._limit:
            gap, turn = np.asarray(goal) - self.place, wanted - self.yaw
            distance = float(np.linalg.norm(gap))
            left = distance + _TURN_WORTH * abs(turn)
            if left < nearest - _GAIN:
                nearest, since = left, self.steps
            there = distance < _NEAR and abs(turn) < _NEAR_TURN
            if there or self.steps - since >= _PATIENCE:
                return
            share = min(1.0, step / max(distance, 1e-9))
            move = gap * share / kinematics.MOVE_STEP
            self.act(np.array([*move, turn / kinematics.TURN_STEP, self.grip]))

    def close(self) -> None:
        """Closes the gripper."""
        self.grip = CLOSED
        self.rest(6)

    def open(self) -> None:
        """Opens the gripper."""
        self.grip = OPEN
        self.rest(5)


_tool = jax.jit(lambda target: kinematics.tcp(target[:7]))


@functools.partial(jax.jit, static_argnames=("dt", "tilt"))
def _aim(target, arm, action, rest, dt, tilt):
    """The controller's aims, and what they make of the tool centre point."""
    target = kinematics.aim(target, arm, action, rest=rest, dt=dt, tilt=tilt)
    return target, kinematics.tcp(target[:7])


def _pose(tool: Frame) -> tuple[np.ndarray, float]:
    """Position, and yaw of a hand that points down, leaning or not."""
    x, y, _ = np.asarray(tool.rotation)[:, 0]
    return np.asarray(tool.position), float(np.arctan2(y, x))


_DOWNWARDS = 0.25  # m/s at most, on the way down to something


class Pace(NamedTuple):
    """The way in which a person carries things."""

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
