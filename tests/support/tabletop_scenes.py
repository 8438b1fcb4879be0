"""Episodes at the table in C MuJoCo, whose actions are kept to be replayed elsewhere."""

import functools

import jax
import numpy as np
from gril_jax.envs.panda import kinematics
from gril_jax.envs.tabletop.moves import Hand
from gril_jax.envs.tabletop.tasks.shoes_in_box import SCRIPT


class Played(Hand):
    """A hand that remembers its actions."""

    def __init__(self, env, start):
        self.actions = []
        super().__init__(env, start)

    def act(self, action):
        self.actions.append(np.clip(action, -1, 1).astype(np.float32))
        super().act(action)


def box_filled(env, start, seed):
    """A whole episode of the shoes' expert."""
    hand = Played(env, start)
    SCRIPT.follow(hand, np.random.default_rng(seed), "success")
    return hand


@functools.cache
def reach():
    """Joints that bring the tool centre point to a frame."""
    near = lambda q, goal: kinematics.reach(q, goal, rest=q)  # noqa: E731
    return jax.jit(lambda q, goal: near(near(q, goal), goal))
