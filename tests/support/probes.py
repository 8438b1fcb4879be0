"""Tiny tasks in plain JAX whose right answer is known, for the tests of the training layer."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from gril_jax.envs import Objects, State
from jaxtyping import Array, Float, Int

from gril_jax.types import DemoBatch


class Data(NamedTuple):
    """Memory of the probe."""

    sign: Float[Array, ""]  # the observation: -1 or 1, drawn anew at each step
    before: Float[Array, ""]  # the sign that the last action answered
    where: Float[Array, "2"]  # of the one block
    time: Int[Array, ""]
    heat: Float[Array, ""]  # not seen: an action above 0.5 raises it
    key: Array


class Probe:
    """One block that the action moves; the observation is a random sign and a constant.

    The reward is action times sign, success a step whose action has that sign.
    Options plant what a test wants to see handled.

    Args:
      ends: control steps after which the task itself ends, or None.
      breaks: from this time on a step yields NaN if the lane was born with `fragile`.
      fragile: share of the episodes that break.
      burns: whether an action above 0.5 makes the state NaN at once.
      clock: whether the constant in the observation is the time instead.
      moved: whether the block has been moved by the start.

    All but `ends` and `breaks` being None may be traced, so that one program tests many probes.
    """

    classes = ("goal", "robot", "green star")
    observation_size = 2
    action_size = 1
    control_hz = 8.0
    half_extent = 1.0
    background = (255, 255, 255)

    def __init__(
        self,
        *,
        episode_length=8,
        ends=None,
        breaks=None,
        fragile=0.0,
        burns=False,
        clock=False,
        moved=False,
    ):
        self.episode_length, self.ends, self.clock, self.moved = episode_length, ends, clock, moved
        self.breaks, self.fragile, self.burns = breaks, fragile, burns

    def reset(self, key):
        key, key_sign, key_heat = jax.random.split(key, 3)
        heat = jax.random.bernoulli(key_heat, self.fragile).astype(jnp.float32)
        sign, start = self._sign(key_sign), jnp.zeros(2)
        data = Data(sign, jnp.zeros(()), start, jnp.zeros((), jnp.int32), heat, key)
        return self._state(data, jnp.zeros(()), jnp.zeros(()))

    def step(self, state, action):
        data = state.data
        action = action[0]
        key, key_sign = jax.random.split(data.key)
        time, heat = data.time + 1, data.heat
        if self.breaks is not None:
            heat = jnp.where((heat > 0) & (time >= self.breaks), jnp.nan, heat)
        heat = jnp.where(jnp.logical_and(self.burns, action > 0.5), jnp.nan, heat)
        where = data.where.at[0].add(0.1 * action)
        fits = (action * data.sign > 0).astype(jnp.float32)
        after = Data(self._sign(key_sign), data.sign, where, time, heat, key)
        return self._state(after, data.sign * action, fits)

    def outlines(self, data):
        return []

    def _sign(self, key):
        return jnp.where(jax.random.bernoulli(key), jnp.float32(1), jnp.float32(-1))

    def _state(self, data, reward, fits):
        done = jnp.zeros(()) if self.ends is None else (data.time >= self.ends).astype(jnp.float32)
        center = jnp.stack([jnp.array([0.5, 0.5]), jnp.array([-0.5, 0.0]), data.where])
        return State(
            data=data,
            obs=jnp.stack([data.sign, jnp.where(self.clock, data.time.astype(jnp.float32), 0.0)]),
            objects=Objects(
                center=center,
                size=jnp.full((3, 2), 0.2),
                label=jnp.arange(3),
                is_robot=jnp.arange(3) == 1,
            ),
            moved=jnp.array([False, False, self.moved]),
            reward=reward,
            done=done,
            metrics={"score": data.time.astype(jnp.float32) / 10, "success": fits},
        )


def carried() -> DemoBatch:
    """Four videos of the probe's objects, in which its block is carried to the goal."""
    begun = jnp.array([[0.5, 0.5], [-0.5, 0.0], [0.0, 0.0]])
    path = jnp.linspace(begun, jnp.array([[0.5, 0.5], [0.3, 0.4], [0.5, 0.5]]), 10)
    return DemoBatch(
        center=jnp.tile(path, (4, 1, 1, 1)),
        size=jnp.full((4, 10, 3, 2), 0.2),
        label=jnp.tile(jnp.arange(3), (4, 1)),
        is_robot=jnp.tile(jnp.arange(3) == 1, (4, 1)),
        present=jnp.ones((4, 3), bool),
        length=jnp.full(4, 10),
    )
