"""Sixteen lanes of MatchRegions with the gripper, compiled once a session, and its starts."""

import functools

import chex
import jax
import jax.numpy as jnp
import numpy as np

from gril_jax import envs

LANES = 16
STAR, SQUARE, BLUE, CIRCLE, YELLOW = range(5)
NAMES = ("green star", "green square", "blue pentagon", "yellow circle", "yellow pentagon")
GOAL = np.array([0.40, 0.35])


@functools.cache
def task():
    return envs.make("match_regions")


@functools.cache
def step():
    """One control step of 16 lanes of any variant, for shapes are data of the variant "all".

    Fails if it is ever traced twice.
    """
    env = envs.make("match_regions", variant="all")

    def gripper_lanes(state, action):  # traces are counted by a function's name
        return jax.vmap(env.step)(state, action)

    return jax.jit(chex.assert_max_traces(gripper_lanes, n=1))


@functools.cache
def starts(**options):
    """A task, and 200 of its starts."""
    env = envs.make("match_regions", **options)
    keys = jax.random.split(jax.random.key(5), 200)
    return env, jax.jit(jax.vmap(env.reset))(keys)


@functools.cache
def demo():
    """16 lanes at the Demo reset."""
    return jax.tree.map(lambda leaf: leaf[:LANES], starts(variant="demo")[1])


@functools.cache
def _observe():
    return jax.jit(jax.vmap(task()._observe))


def observe(pose, velocity=None):
    """States of 16 lanes from poses, perhaps velocities; distances as at reset."""
    velocity = np.zeros_like(pose) if velocity is None else velocity
    data = demo().data._replace(
        pose=jnp.asarray(pose, jnp.float32), velocity=jnp.asarray(velocity, jnp.float32)
    )
    return _observe()(data)


def at_demo(changes):
    """The Demo layout but for these: of each lane a dict, block -> (x, y[, angle])."""
    pose = np.array(demo().data.pose)
    for lane, moves in enumerate(changes):
        for block, place in moves.items():
            pose[lane, 3 + block, : len(place)] = place
    return observe(pose)
