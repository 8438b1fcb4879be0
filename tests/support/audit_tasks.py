"""Small tasks by their stages alone, and rewards of them that are known to be good or bad."""

import jax
import jax.numpy as jnp
from gril_jax.envs.stages import Stage, Stages

from gril_jax.audit.scene_reward import Scene

# Robot, lid, two shoes, a stone; of a plane |x|, |y| <= 1.
NAMES = ("robot", "lid", "shoe A", "shoe B", "stone")
START = jnp.array([[-0.8, -0.8], [0.5, 0.8], [-0.5, 0.1], [-0.1, -0.5], [0.8, -0.8]])
SIZE = jnp.full((5, 2), 0.2)
BOX = jnp.array([0.5, 0.5])  # where shoes belong, within 0.25
LABEL = jnp.arange(5)


def _share_done(task, center, size):
    """The score of a task without faults: the share of its stages that are done."""
    return jnp.mean(task.done(center, size).astype(jnp.float32))


def start():
    """The scene after a reset."""
    return Scene(START, SIZE, LABEL, LABEL == 0, jnp.zeros(5, bool))


def _in_box(index):
    return lambda c, s: (jnp.abs(c[index] - BOX) <= 0.25).all()


def _into_box(index):
    def place(key, center, size):
        offset = jax.random.uniform(key, (2,), minval=-0.1, maxval=0.1)
        return center.at[index].set(BOX + offset)

    return place


def _open(key, center, size):
    x = jax.random.uniform(key, minval=-0.8, maxval=-0.4)
    return center.at[1].set(jnp.stack([x, 0.8 + 0 * x]))


LID = Stage("lid open", (1,), lambda c, s: c[1, 0] < -0.2, _open)


def packing():
    """Lid open, then shoe A in, then shoe B in: stages that depend on each other."""
    first = Stage("shoe A in", (2,), _in_box(2), _into_box(2), ("lid open",))
    second = Stage("shoe B in", (3,), _in_box(3), _into_box(3), ("shoe A in",))
    return Stages((LID, first, second), (1, 2, 3, 4), 1.0, _share_done, robots=(0,))


def one_shoe():
    """Shoe A in, and not the stone: one stage and one fault."""
    return _without_stone(Stage("shoe A in", (2,), _in_box(2), _into_box(2)))


def shoes(*indices):
    """These shoes in, in any order, and not the stone."""
    return _without_stone(*(Stage(NAMES[i], (i,), _in_box(i), _into_box(i)) for i in indices))


def _without_stone(*stages):
    def score(task, center, size):
        fault = task.faulty(center, size).any()
        return jnp.where(fault, 0.5, 1.0) * _share_done(task, center, size)

    fault = Stage("stone in", (4,), _in_box(4), _into_box(4))
    return Stages(stages, (1, 2, 3, 4), 1.0, score, (fault,), (0,))


def sound(task):
    """True progress itself, and a slope of at most a tenth towards it."""

    def reward(params, scene):
        near = -jnp.sum((scene.center[2] - BOX) ** 2) / 40
        return params * (task.progress(scene.center, scene.size) + near - 1.0)

    return reward
