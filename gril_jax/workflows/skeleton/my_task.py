"""A robot pushes a block into a region: a task to be changed into your own.

    gril check-task my_task.py:make                    what is missing, in sentences
    gril demos make --task my_task.py:make --out mine  videos of the expert, or import your own
    gril train --task my_task.py:make --demos mine     a reward from videos, a policy from it

Everything is plain JAX and pure: no `if` on a value that is only known when it runs (jnp.where
instead), and no state kept on the side.
"""

import jax
import jax.numpy as jnp

from gril_jax.envs import Objects, State
from gril_jax.envs.stages import put_inside

REGION = jnp.array([0.6, 0.0])
SIZES = jnp.array([[0.5, 0.5], [0.16, 0.16], [0.2, 0.2]])  # width and height of each box
TOUCH = 0.18  # distance at which robot and block touch
SPEED = 0.08  # of the robot, a step


class Task:
    # --- what every task has
    classes = ("region", "robot", "block")  # the words of your videos' boxes
    action_size = 2  # numbers that a policy gives, each in [-1, 1]

    # --- what has a usual value otherwise
    episode_length = 60  # steps until the time limit (100)
    control_hz = 10.0  # steps a second, as the videos have frames (10)
    half_extent = 1.0  # half the width of what a picture shows, in your unit (1)

    # --- optional: gril audit asks which progress a state is
    stages = put_inside((2,), 0, robots=(1,), half_extent=half_extent)

    def __init__(self, speed: float = SPEED):
        self.speed = speed  # an option: --env.options speed=0.1

    def reset(self, key):
        """A start; success is counted over as many different ones as this samples."""
        key_robot, key_block = jax.random.split(key)
        block = jax.random.uniform(key_block, (2,), minval=-0.5, maxval=0.2)
        angle = jax.random.uniform(key_robot, (), maxval=2 * jnp.pi)
        robot = block + 0.35 * jnp.array([jnp.cos(angle), jnp.sin(angle)])
        return self._state(robot, block)

    def step(self, state, action):
        """The state after an action; `state` is what `reset` or `step` returned."""
        robot, block = state.data
        robot = jnp.clip(robot + self.speed * jnp.clip(action, -1, 1), -0.9, 0.9)
        offset = block - robot
        distance = jnp.sqrt(jnp.sum(offset**2) + 1e-9)
        pushed = robot + TOUCH * offset / distance
        return self._state(robot, jnp.clip(jnp.where(distance < TOUCH, pushed, block), -0.9, 0.9))

    def _state(self, robot, block):
        objects = Objects(
            center=jnp.stack([REGION, robot, block]),  # (objects, 2), x to the right, y upwards
            size=SIZES,
            label=jnp.array([0, 1, 2]),  # an index into `classes` for each object
            is_robot=jnp.array([False, True, False]),
        )
        inside = (jnp.abs(block - REGION) < SIZES[0] / 2).all()
        return State(
            data=(robot, block),  # whatever `step` needs
            obs=jnp.concatenate(
                [robot, block, block - robot, block - REGION]
            ),  # what a policy sees
            objects=objects,
            metrics={"success": inside},  # only counted: no reward is taken from it
        )

    def expert(self, state, key):
        """Optional: an action that demonstrates the task, for gril demos make."""
        robot, block = state.data
        way = (REGION - block) / (jnp.linalg.norm(REGION - block) + 1e-6)
        side = jnp.array([-way[1], way[0]])
        along, across = (robot - block) @ way, (robot - block) @ side
        around = block - 0.24 * way + 0.3 * side * jnp.where(across < 0, -1.0, 1.0)
        behind = jnp.where(jnp.abs(across) < 0.05, block, block - 0.24 * way)
        move = (jnp.where(along > -0.12, around, behind) - robot) / self.speed
        noise = 0.1 * jax.random.normal(key, (2,))  # people are not exact either
        at_goal = jnp.abs(block - REGION).max() < 0.15
        return jnp.where(at_goal, 0.0, move / jnp.maximum(1.0, jnp.abs(move).max()) + noise)


def make(**options):
    """The task, made for gril; keyword arguments are options: --env.options NAME=VALUE."""
    return Task(**options)
