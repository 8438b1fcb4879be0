"""A pendulum to be swung up, as a task of this library: good returns are known for it."""

import jax
import jax.numpy as jnp
from gril_jax.envs import Objects, State


class Bare:
    """A task without pictures or blocks: two points stand in for its objects."""

    classes = ("goal", "robot")
    half_extent = 1.2
    background = (255, 255, 255)

    def outlines(self, data):
        """Nothing to draw."""
        return []

    def _state(self, data, obs, centers, reward, success, done) -> State:
        objects = Objects(
            center=jnp.stack(centers), size=jnp.full((2, 2), 0.1), label=jnp.arange(2),
            is_robot=jnp.arange(2) == 1,
        )  # fmt: skip
        return State(
            data=data, obs=obs, objects=objects, moved=jnp.array([False, False]), reward=reward,
            done=done, metrics={"score": success, "success": success},
        )  # fmt: skip


class Pendulum(Bare):
    """A hanging rod, to be swung up and held by a motor too weak to lift it.

    The dynamics of Gymnasium's Pendulum-v1: 1 m, 1 kg, at most 2 N m, 20 Hz. About -150 in all is a
    good episode, and -1,200 that of an idle or a random motor.
    """

    observation_size = 3  # cosine and sine of the angle from upright, speed / 8
    action_size = 1  # torque / 2
    control_hz = 20.0
    episode_length = 200

    def reset(self, key):
        """Starts at any angle, and at up to 1 rad/s."""
        low, high = jnp.array([-jnp.pi, -1.0]), jnp.array([jnp.pi, 1.0])
        return self._now(jax.random.uniform(key, (2,), minval=low, maxval=high), jnp.zeros(()))

    def step(self, state, action):
        """Advances a twentieth of a second."""
        angle, speed = state.data
        torque = 2.0 * jnp.clip(action[0], -1.0, 1.0)
        away = (angle + jnp.pi) % (2 * jnp.pi) - jnp.pi
        cost = away**2 + 0.1 * speed**2 + 0.001 * torque**2
        speed = jnp.clip(speed + (15.0 * jnp.sin(angle) + 3.0 * torque) / 20, -8.0, 8.0)
        return self._now(jnp.stack([angle + speed / 20, speed]), -cost)

    def _now(self, data, reward):
        angle, speed = data
        tip = jnp.stack([jnp.sin(angle), jnp.cos(angle)])
        upright = (jnp.cos(angle) > 0.9).astype(jnp.float32)
        obs = jnp.stack([jnp.cos(angle), jnp.sin(angle), speed / 8])
        ends = jnp.array([0.0, 1.0]), tip
        return self._state(data, obs, ends, reward, upright, done=jnp.zeros(()))
