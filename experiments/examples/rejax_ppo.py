"""A policy trained on the reward by rejax's PPO, in a gymnax environment.

python -m gril_jax.experiments.examples.rejax_ppo reward.npz     needs gymnax and rejax

The reward is that of `learn_reward`. An episode's mean return rises from -24 to about -12.6, which
is what driving straight at the block brings; half a minute on two cores.
"""

import sys
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import rejax
from gymnax.environments import spaces
from gymnax.environments.environment import Environment, EnvParams

from gril_jax.export.gymnax import RewardWrapper
from gril_jax.export.reward_file import load_reward

from . import pushing


class State(NamedTuple):
    time: jax.Array  # steps since the reset
    table: jax.Array


class Pushing(Environment):
    """The toy world as a gymnax environment, without a reward."""

    default_params = EnvParams(max_steps_in_episode=24)

    def reset_env(self, key, params):
        table = pushing.reset(key)
        return table.ravel(), State(jnp.zeros((), jnp.int32), table)

    def step_env(self, key, state, action, params):
        state = State(state.time + 1, pushing.step(state.table, action))
        return state.table.ravel(), state, jnp.zeros(()), jnp.zeros((), bool), {}

    def action_space(self, params):
        return spaces.Box(-1.0, 1.0, (2,))

    def observation_space(self, params):
        return spaces.Box(-1.0, 1.0, (6,))


def main(path: str, *, steps: int = 1_048_576, echo: Callable[[str], None] = print) -> jax.Array:
    """Trains a policy; returns the mean return before and after it."""
    learned = load_reward(path)
    env = RewardWrapper(Pushing(), learned, lambda s: pushing.boxes(s.table), five_values=True)
    chosen = {"num_envs": 256, "num_steps": 24, "num_minibatches": 4, "learning_rate": 2e-3}
    ppo = rejax.PPO.create(env=env, total_timesteps=steps, eval_freq=steps, **chosen)
    _, (_, returns) = jax.jit(ppo.train)(jax.random.key(0))
    echo(f"mean return before and after {steps} steps: {returns.mean(axis=1).tolist()}")
    return returns.mean(axis=1)


if __name__ == "__main__":
    main(sys.argv[1])
