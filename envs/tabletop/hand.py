"""The arm in C MuJoCo: a scripted episode of a tabletop task, recorded step by step.

Model, controller and control rate are those of the environment. C MuJoCo needs no compilation and
plays one episode faster than MJX on a CPU plays many: 400 control steps in 0.13 s.
"""

import functools

import jax
import mujoco
import numpy as np
from gril_jax.envs.base import State
from gril_jax.envs.panda import kinematics
from gril_jax.envs.panda.frames import Frame
from gril_jax.envs.tabletop.environment import Tabletop
from jaxtyping import Float

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
