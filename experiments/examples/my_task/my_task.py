"""Push a puck onto a mat with a hand, seen from above: a task of one's own in plain JAX.

    python make_films.py                                 videos, and from them the set `mine`
    gril check-task my_task.py:make
    gril train my_task.yaml --task my_task.py:make --demos mine

The table is |x|, |y| <= 1. An action (2,) in [-1, 1] moves the hand by at most 0.08 a step.
"""

import jax
import jax.numpy as jnp
from gril_jax.envs import Objects, State
from gril_jax.envs.stages import put_inside

MAT = jnp.array([0.6, 0.0])
SIZES = jnp.array([[0.5, 0.5], [0.16, 0.16], [0.2, 0.2]])  # of mat, hand and puck
TOUCH = 0.18  # half of hand and puck together


class PushPuck:
    classes = ("mat", "hand", "puck")
    action_size, episode_length, control_hz, half_extent = 2, 60, 10.0, 1.0
    stages = put_inside((2,), 0, robots=(1,), half_extent=1.0)  # optional: gril audit needs them

    def reset(self, key):
        key_hand, key_puck = jax.random.split(key)
        puck = jax.random.uniform(key_puck, (2,), minval=-0.5, maxval=0.2)
        away = jax.random.uniform(key_hand, (), maxval=2 * jnp.pi)
        hand = puck + 0.35 * jnp.array([jnp.cos(away), jnp.sin(away)])
        return self.state(hand, puck)

    def step(self, state, action):
        hand, puck = state.data
        hand = jnp.clip(hand + 0.08 * jnp.clip(action, -1, 1), -0.9, 0.9)
        offset = puck - hand
        distance = jnp.sqrt(jnp.sum(offset**2) + 1e-9)
        pushed = hand + TOUCH * offset / distance
        return self.state(hand, jnp.clip(jnp.where(distance < TOUCH, pushed, puck), -0.9, 0.9))

    def state(self, hand, puck):
        objects = Objects(
            center=jnp.stack([MAT, hand, puck]),
            size=SIZES,
            label=jnp.arange(3),
            is_robot=jnp.array([False, True, False]),
        )
        success = (jnp.abs(puck - MAT) < 0.25).all()
        obs = jnp.concatenate([hand, puck, puck - hand, puck - MAT])
        return State((hand, puck), obs, objects, metrics={"success": success})


def make():
    return PushPuck()
