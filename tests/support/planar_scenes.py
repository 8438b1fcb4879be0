"""Lanes of MatchRegions scenes that are played side by side, each compiled once a session."""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.planar import shapes

from gril_jax import envs

LANES, STEPS = 16, 26
OPEN = math.pi / 8
STAR, SQUARE, BLUE, CIRCLE, YELLOW = range(5)
NAMES = ("green star", "green square", "blue pentagon", "yellow circle", "yellow pentagon")
LEFT, RIGHT = math.pi / 2, -math.pi / 2  # headings
AWAY = [(0.9, 0.9, 0), (-0.9, 0.9, 0), (-0.9, -0.9, 0), (0.9, -0.9, 0), (0.93, 0.5, 0)]


@functools.cache
def task(robot="gripper", iterations=10):
    """The Demo task with that robot; 10 iterations are the original's."""
    return envs.make("match_regions", robot=robot, iterations=iterations)


def turned(points, angle):
    """Points (..., 2) rotated counter-clockwise."""
    c, s = math.cos(angle), math.sin(angle)
    return np.asarray(points) @ np.array([[c, s], [-s, c]])


def parts(robot, base, opening=OPEN):
    """Poses (P, 3) of a robot's parts; `opening` is that of both fingers."""
    if robot != "gripper":
        return np.array([base], float)
    x, y, yaw = base
    pivots = turned([[-0.09, 0.02], [0.09, 0.02]], yaw) + [x, y]
    fingers = [(*p, yaw + s * opening) for p, s in zip(pivots, (1, -1), strict=True)]
    return np.array([base, *fingers])


def scene(robot, base, blocks=None, opening=OPEN):
    """Poses (E, 3): the robot at `base`, blocks out of the way but for those given."""
    blocks = blocks or {}
    rest = [blocks.get(b, away) for b, away in enumerate(AWAY)]
    return np.concatenate([parts(robot, base, opening), np.array(rest, float)])


@functools.cache
def _begin(robot, iterations):
    return jax.jit(jax.vmap(task(robot, iterations).reset_to))


@functools.cache
def _roll(robot, iterations):
    step = jax.vmap(task(robot, iterations).step)

    def move(state, action):
        state = step(state, action)
        return state, state

    return jax.jit(lambda state, actions: jax.lax.scan(move, state, actions))


def begin(pose, velocity=None, *, robot="gripper", iterations=10):
    """States of 16 lanes at given poses (16, E, 3)."""
    velocity = np.zeros_like(pose) if velocity is None else velocity
    as_floats = [jnp.asarray(f, jnp.float32) for f in (pose, velocity)]
    return _begin(robot, iterations)(*as_floats)


def play(state, actions, *, robot="gripper", iterations=10):
    """Poses (16, 27, E, 3) under actions (26, 16, A), the reset's first, and all later states."""
    _, states = _roll(robot, iterations)(state, jnp.asarray(actions, jnp.float32))
    poses = np.concatenate([np.asarray(state.data.pose)[None], np.asarray(states.data.pose)])
    return np.swapaxes(poses, 0, 1), states


def overhang(env, pose):
    """Distance by which bodies (..., E, 3) stand out of the arena: the greatest of each scene.

    From the outlines of all parts and blocks, in numpy.
    """
    outlines = [p.outline for p in env.robot.parts]
    outlines += [shapes.outline(name.split()[1]) for name in env.blocks]
    worst = np.full(pose.shape[:-2], -np.inf)
    for e, outline in enumerate(outlines):
        c, s = np.cos(pose[..., e, 2, None]), np.sin(pose[..., e, 2, None])
        x = pose[..., e, 0, None] + c * outline[:, 0] - s * outline[:, 1]
        y = pose[..., e, 1, None] + s * outline[:, 0] + c * outline[:, 1]
        worst = np.maximum(worst, np.maximum(abs(x), abs(y)).max(axis=-1) - env.arena)
    return worst


def signed_distance(x, y, vertices):
    """Signed distances of points to a polygon, in float64; negative inside."""
    best, inside = np.full(np.broadcast(x, y).shape, np.inf), False
    for (ax, ay), (bx, by) in zip(vertices, np.roll(vertices, -1, axis=0), strict=True):
        dx, dy = bx - ax, by - ay
        share = np.clip(((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy), 0, 1)
        best = np.minimum(best, np.hypot(x - ax - share * dx, y - ay - share * dy))
        crosses = (ay > y) != (by > y)
        inside = inside ^ (crosses & (x < ax + (y - ay) / (dy or np.inf) * dx))
    return np.where(inside, -best, best)
