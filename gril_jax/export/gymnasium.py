"""A learned reward for Gymnasium environments; needs the package `gymnasium`.

    env = RewardWrapper(gymnasium.make(...), load_reward("reward.npz"), boxes)

For one environment at a time. The reward's memory begins anew with every `reset`.
"""

from collections.abc import Callable
from typing import Any

import gymnasium
import jax
import numpy as np

from gril_jax.reward.learned_reward import LearnedReward


class RewardWrapper(gymnasium.Wrapper):
    """The environment with the learned reward; its own is `info["task_reward"]` from then on.

    `boxes(env, observation)`, of the environment unwrapped, gives box centres and sizes: arrays of
    shape (N, 2) in the order of `learned.objects`, in the world units of the reward.
    """

    def __init__(
        self,
        env: gymnasium.Env,
        learned: LearnedReward,
        boxes: Callable[[gymnasium.Env, Any], tuple[Any, Any]],
    ):
        super().__init__(env)
        self._boxes, self._memory = boxes, None
        self._init = jax.jit(learned.init)
        self._step = jax.jit(learned.step)

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        """Starts an episode; `options` are the environment's."""
        observation, info = self.env.reset(**options)
        self._memory = self._init(*self._seen(observation))
        return observation, info

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Advances one step, with its learned reward."""
        observation, task_reward, terminated, truncated, info = self.env.step(action)
        self._memory, reward = self._step(self._memory, *self._seen(observation))
        info = {**info, "task_reward": task_reward}
        return observation, float(reward), terminated, truncated, info

    def _seen(self, observation):
        center, size = self._boxes(self.env.unwrapped, observation)
        return np.asarray(center, np.float32), np.asarray(size, np.float32)
