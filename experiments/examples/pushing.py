"""A toy world for the examples: a robot on a table that pushes objects.

Objects, in the order of `OBJECTS`: a goal that never moves, the robot, a block. Positions are
table units, |x|, |y| <= 1; an action (2,) in [-1, 1] moves the robot by a twentieth of it.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from gril_jax.graphs.scene import safe_norm
from gril_jax.types import DemoBatch

CLASSES = OBJECTS = ("goal", "robot", "block")
ROBOTS = ("robot",)
_SIZE = ((0.3, 0.3), (0.1, 0.1), (0.1, 0.1))
_TOUCH, _SPEED = 0.1, 0.05

Table = Float[Array, "3 2"]  # the objects' centres


def reset(key: PRNGKeyArray) -> Table:
    """Starts with robot, block and goal from left to right, roughly on one line."""
    y, jitter = jax.random.uniform(key, (2,), minval=-0.5, maxval=0.5)
    return jnp.array([[0.7, 0.0], [-0.7, 0.0], [-0.4, 0.0]]) + jnp.array([0.1 * jitter, y])


def step(table: Table, action: Float[Array, "2"]) -> Table:
    """Moves the robot; it pushes a block that it would overlap out of its way."""
    goal, robot, block = table
    robot = jnp.clip(robot + _SPEED * jnp.clip(action, -1.0, 1.0), -1.0, 1.0)
    offset = block - robot
    distance = safe_norm(offset)
    pushed = robot + _TOUCH * offset / jnp.where(distance > 0, distance, 1.0)
    return jnp.stack([goal, robot, jnp.where(distance < _TOUCH, pushed, block)])


def boxes(table: Table) -> tuple[Float[Array, "3 2"], Float[Array, "3 2"]]:
    """Centres and sizes, as a detector would report them."""
    return table, jnp.array(_SIZE)


def demonstrations(key: PRNGKeyArray, num: int = 8, num_frames: int = 24) -> DemoBatch:
    """Recordings in which the robot drives at the block and pushes it into the goal."""

    def one(key):
        first = reset(key)
        drive = jnp.array([1.0, 0.0])
        steps = jax.lax.scan(lambda t, _: (step(t, drive),) * 2, first, length=num_frames - 1)
        return jnp.concatenate([first[None], steps[1]])

    center = jax.vmap(one)(jax.random.split(key, num))
    size = jnp.broadcast_to(jnp.array(_SIZE), center.shape)
    label = jnp.tile(jnp.arange(3), (num, 1))
    present, length = jnp.ones_like(label, bool), jnp.full(num, num_frames)
    return DemoBatch(center, size, label, label == 1, present, length)
