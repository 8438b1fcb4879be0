"""The reward in a Gymnasium environment, in any language or library.

python -m gril_jax.experiments.examples.gymnasium_wrapper reward.npz     needs gymnasium

With the reward of `learn_reward` both episodes end above -0.1.
"""

import sys
from collections.abc import Callable

import gymnasium
import jax
import numpy as np

from gril_jax.export.gymnasium import RewardWrapper
from gril_jax.export.reward_file import load_reward

from . import pushing


class Pushing(gymnasium.Env):
    """The toy world as a Gymnasium environment, without a reward."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (3, 2), np.float32)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)

    def __init__(self):
        self._step = jax.jit(pushing.step)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.table = pushing.reset(jax.random.key(int(self.np_random.integers(2**31))))
        return np.asarray(self.table), {}

    def step(self, action):
        self.table = self._step(self.table, action)
        return np.asarray(self.table), 0.0, False, False, {}


def main(path: str, *, echo: Callable[[str], None] = print) -> list[float]:
    """Drives through two episodes of 23 steps; returns their rewards."""
    env = RewardWrapper(Pushing(), load_reward(path), lambda env, _: pushing.boxes(env.table))
    env = gymnasium.wrappers.TimeLimit(env, 23)
    rewards = []
    for episode in range(2):
        env.reset(seed=episode)
        truncated = False
        while not truncated:
            _, reward, _, truncated, _ = env.step(np.array([1.0, 0.0], np.float32))
            rewards.append(reward)
    echo(f"two episodes end at {rewards[22]:.3f} and {rewards[-1]:.3f}")
    return rewards


if __name__ == "__main__":
    main(sys.argv[1])
