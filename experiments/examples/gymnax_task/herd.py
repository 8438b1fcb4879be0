"""A dog drives a sheep into a pen: an environment in the style of gymnax, and its task in 15 lines.

    gril demos make --task herd.py:make --out mine
    gril train herd.yaml --task herd.py:make --demos mine

`Herd` needs no gymnax; one of gymnax's own environments is adapted in the same way.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from gril_jax.envs import of_gymnax

FIELD, PEN = 1.0, jnp.array([0.6, 0.6])  # half the field's width, the pen's middle


class Params(NamedTuple):
    max_steps_in_episode: int = 80


class EnvState(NamedTuple):
    time: jax.Array
    dog: jax.Array
    sheep: jax.Array


class Box(NamedTuple):
    low: float
    high: float
    shape: tuple[int, ...]


class Herd:
    """The sheep runs from a dog that is nearer than 0.3, faster the nearer it is."""

    default_params = Params()

    def action_space(self, params):
        return Box(-0.08, 0.08, (2,))  # a step

    def reset_env(self, key, params):
        dog, sheep = jax.random.uniform(key, (2, 2), minval=-0.6, maxval=0.2)
        return self.observe(state := EnvState(jnp.int32(0), dog, sheep)), state

    def step_env(self, key, state, action, params):
        dog = jnp.clip(state.dog + jnp.clip(action, -0.08, 0.08), -FIELD, FIELD)
        away = state.sheep - dog
        distance = jnp.sqrt(jnp.sum(away**2) + 1e-6)
        sheep = state.sheep + 0.07 * away / distance * jnp.clip(1.5 - 5 * distance, 0.0, 1.0)
        state = EnvState(state.time + 1, dog, jnp.clip(sheep, -0.9, 0.9))
        return self.observe(state), state, 0.0, False, {}

    def observe(self, state):
        return jnp.concatenate([state.dog, state.sheep, state.sheep - state.dog])


# --- what gril needs


def make():
    return of_gymnax(
        Herd(), boxes, objects=("pen", "dog", "sheep"), robots=("dog",), success=in_pen,
        half_extent=FIELD, expert=drive,
    )  # fmt: skip


def boxes(state):
    sizes = jnp.array([[0.5, 0.5], [0.1, 0.1], [0.12, 0.12]])
    return jnp.stack([PEN, state.dog, state.sheep]), sizes


def in_pen(state):
    return (jnp.abs(state.sheep - PEN) < 0.25).all()


def drive(state, key):
    """An expert, for videos: it gets behind the sheep as seen from the pen, then comes closer."""
    _, dog, sheep = state.data[0]
    way = (PEN - sheep) / (jnp.linalg.norm(PEN - sheep) + 1e-6)
    side = jnp.array([-way[1], way[0]])
    along, across = (dog - sheep) @ way, (dog - sheep) @ side
    around = sheep - 0.3 * way + 0.4 * side * jnp.where(across < 0, -1.0, 1.0)
    aim = jnp.where(along > -0.1, around, sheep - 0.14 * way)
    move = (aim - dog) / 0.08
    noise = 0.1 * jax.random.normal(key, (2,))
    return jnp.where(
        in_pen(state.data[0]), 0.0, move / jnp.maximum(1.0, jnp.abs(move).max()) + noise
    )
