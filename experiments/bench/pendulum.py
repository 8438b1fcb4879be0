"""The task for comparing trainers with brax's: a pendulum, cheap enough to expose their speed.

It follows this library's protocol, and `stock` puts brax's around it.
"""

import dataclasses

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


@dataclasses.dataclass(frozen=True)
class _Training:
    """Length of both sides' training, and the hyper-parameters that both algorithms have."""

    num_timesteps: int = 51_200
    """Steps of one run; both sides round it up to whole updates between two evaluations."""
    num_envs: int = 128
    unroll_length: int = 20
    discounting: float = 0.95
    reward_scaling: float = 0.1
    num_evals: int = 3
    """Evaluations, of which the first is that of the untrained policy."""
    hidden: tuple[int, ...] = (64, 64)
    learning_rate: float = 1e-3

    @property
    def parts(self) -> int:
        """Number of parts of the training, each with an evaluation at its end."""
        return self.num_evals - 1

    @property
    def updates(self) -> int:
        """Number of updates between two evaluations."""
        return -(-self.num_timesteps // (self.num_envs * self.unroll_length * self.parts))

    @property
    def steps(self) -> int:
        """Control steps of all environments between two evaluations."""
        return self.updates * self.num_envs * self.unroll_length


@dataclasses.dataclass(frozen=True)
class Setting(_Training):
    """PPO's hyper-parameters, and how long both sides train."""

    num_minibatches: int = 4
    num_epochs: int = 4
    gae_lambda: float = 0.95
    entropy_cost: float = 1e-3
    clipping_epsilon: float = 0.2
    max_grad_norm: float = 1.0


@dataclasses.dataclass(frozen=True)
class SacSetting(_Training):
    """Soft actor-critic's hyper-parameters, and how long both sides train."""

    num_timesteps: int = 20_480
    num_envs: int = 32
    unroll_length: int = 1
    discounting: float = 0.98
    reward_scaling: float = 1.0
    updates_per_step: int = 32
    """Gradient steps for each control step of all environments."""
    batch_size: int = 256
    replay_size: int = 2**17
    min_replay: int = 1024
    soft_update: float = 0.005
