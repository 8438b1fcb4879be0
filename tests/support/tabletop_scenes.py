"""Tabletop scenes played in C MuJoCo, which needs no compilation: same model, same controller."""

import functools

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from gril_jax.envs.panda import kinematics


class InC:
    """An environment's episode in C MuJoCo.

    `step` applies an action; `qpos`, `target` and `contacts` are what it has come to.
    """

    def __init__(self, env, start):
        self.env, data = env, jax.tree.map(np.asarray, start.data)
        self.model = env.physics.mj_model
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:] = data.motion.qpos
        self.data.mocap_pos[:], self.data.mocap_quat[:] = np.split(data.fixtures, [3], axis=1)
        self.target, self.fixtures, self.contacts = data.target, data.fixtures, 0

    def step(self, action):
        aim = _aim(tuple(self.env.task.home), self.env.physics.dt)
        action = np.clip(np.asarray(action, np.float32), -1, 1)
        q = self.data.qpos[:7].astype(np.float32)
        self.target = np.asarray(aim(self.target, q, action))
        self.drive(self.target)

    def drive(self, target):
        self.data.ctrl[:] = target
        for _ in range(self.env.physics.substeps):
            mujoco.mj_step(self.model, self.data)
            self.contacts = max(self.contacts, self.data.ncon)

    @property
    def qpos(self):
        return self.data.qpos

    def move(self, goal, grip, *, speed=0.25, yaw=0.0, settle=0):
        """Linear motion of the tool centre point."""
        step, actions = speed * self.env.physics.dt, []
        for _ in range(200):
            now, turned = _tool(self.target)
            gap = np.asarray(goal, np.float32) - now
            size = np.linalg.norm(gap)
            move = gap * min(1.0, step / max(size, 1e-9)) / 0.025
            turn = np.clip((yaw - turned) / 0.1, -1, 1)
            actions.append(np.array([*move, turn, grip], np.float32))
            self.step(actions[-1])
            if size < max(step, 2e-3) and abs(yaw - turned) < 0.1:
                break
        for _ in range(settle):
            actions.append(np.array([0, 0, 0, 0, grip], np.float32))
            self.step(actions[-1])
        return actions


@functools.cache
def _aim(rest, dt):
    rest = jnp.array(rest, jnp.float32)
    aim = functools.partial(kinematics.aim, rest=rest, dt=dt)
    return jax.jit(aim)


@functools.cache
def _tool_of():
    return jax.jit(kinematics.tcp)


def _tool(target):
    """Place of the tool centre point, and the hand's yaw."""
    frame = _tool_of()(target[:7])
    forward = np.asarray(frame.rotation)[:, 0]
    return np.asarray(frame.position), float(np.arctan2(forward[1], forward[0]))


def turned(fixture, point):
    """A point of the box's frame in the world."""
    c, s = 1 - 2 * fixture[6] ** 2, 2 * fixture[3] * fixture[6]
    x, y, z = point
    return np.array([fixture[0] + c * x - s * y, fixture[1] + s * x + c * y, fixture[2] + z])


def open_lid(play):
    """Lift the lid from below with closed fingers and push it over."""
    box = play.fixtures[0]
    yaw = 2 * np.arctan2(box[6], box[3])
    path = [(0.21, 0.2), (0.195, 0.1), (0.155, 0.1), (0.15, 0.22), (0.11, 0.3), (0.05, 0.37),
            (-0.02, 0.41), (-0.12, 0.43), (-0.2, 0.42), (-0.05, 0.45)]  # fmt: skip
    done = []
    for y, z in path:
        done += play.move(turned(box, (0.0, y, z)), -1.0, yaw=yaw)
    return done


def grasp(play, shoe, *, lift=0.3):
    """Take a shoe (0 or 1) and lift it."""
    place = play.qpos[10 + 7 * shoe : 17 + 7 * shoe]
    yaw = 2 * np.arctan2(place[6], place[3])
    x, y = place[:2]
    done = play.move((x, y, 0.25), 1.0, yaw=yaw)
    done += play.move((x, y, 0.03), 1.0, yaw=yaw, settle=3)
    done += play.move((x, y, 0.03), -1.0, yaw=yaw, settle=6)
    return done + play.move((x, y, lift), -1.0, yaw=yaw, settle=2)


def drop(play, where):
    """Let go above a place (x, y) of the box's frame."""
    box = play.fixtures[0]
    yaw = 2 * np.arctan2(box[6], box[3])
    done = play.move(turned(box, (*where, 0.3)), -1.0, yaw=yaw)
    done += play.move(turned(box, (*where, 0.12)), -1.0, yaw=yaw, settle=4)
    done += play.move(turned(box, (*where, 0.12)), 1.0, yaw=yaw, settle=5)
    return done + play.move(turned(box, (*where, 0.3)), 1.0, yaw=yaw)


def fill_box(play):
    """The whole task: lid, then the nearer shoe, then the other one."""
    done = open_lid(play)
    for shoe, where in ((0, (-0.03, -0.05)), (1, (0.0, 0.05))):
        done += grasp(play, shoe)
        done += drop(play, where)
    return done


@functools.cache
def reach():
    """Joints that bring the tool centre point to a frame."""
    near = lambda q, goal: kinematics.reach(q, goal, rest=q)  # noqa: E731
    return jax.jit(lambda q, goal: near(near(q, goal), goal))
