"""The reward in an environment of brax (or MuJoCo Playground), under brax's training wrappers.

python -m gril_jax.experiments.examples.brax_wrapper reward.npz

With the reward of `learn_reward` both episodes end above -0.1, the second after an automatic reset.
"""

import sys
from collections.abc import Callable

import jax
import jax.numpy as jnp
from brax.envs.base import Env, State
from brax.envs.wrappers import training

from gril_jax.export.brax import RewardWrapper
from gril_jax.export.reward_file import load_reward

from . import pushing


class Pushing(Env):
    """The toy world as a brax environment, without a reward."""

    observation_size, action_size, backend = 6, 2, "none"

    def reset(self, rng: jax.Array) -> State:
        return self._state(pushing.reset(rng))

    def step(self, state: State, action: jax.Array) -> State:
        after = self._state(pushing.step(state.pipeline_state, action))
        return after.replace(metrics=state.metrics, info=state.info)

    def _state(self, table):
        zero = jnp.zeros(())
        return State(table, obs=table.ravel(), reward=zero, done=zero)


def main(path: str, *, episodes: int = 8, echo: Callable[[str], None] = print) -> jax.Array:
    """Drives through two episodes of 23 steps; returns the rewards (46, episodes)."""
    env = RewardWrapper(Pushing(), load_reward(path), lambda s: pushing.boxes(s.pipeline_state))
    env = training.wrap(env, episode_length=23)
    actions = jnp.tile(jnp.array([1.0, 0.0]), (episodes, 1))

    def step(state, _):
        state = env.step(state, actions)
        return state, state.reward

    keys = jax.random.split(jax.random.PRNGKey(0), episodes)  # brax wants keys of the old type
    state = jax.jit(env.reset)(keys)
    _, rewards = jax.jit(lambda s: jax.lax.scan(step, s, length=46))(state)
    mean = rewards.mean(axis=1)
    echo(f"two episodes end at {mean[22]:.3f} and {mean[45]:.3f}")
    return rewards


if __name__ == "__main__":
    main(sys.argv[1])
