"""A learned reward for gymnax environments; needs the package `gymnax`, 1.0 or later.

    env = RewardWrapper(env, load_reward("reward.npz"), boxes)
    algorithm = rejax.PPO.create(env=RewardWrapper(..., five_values=True), ...)

The reward's memory is part of the state, so gymnax's automatic reset begins it anew.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from gymnax.environments.environment import Environment
from jaxtyping import Array, Float, PRNGKeyArray

from gril_jax.reward.learned_reward import LearnedReward, Memory


class RewardState(NamedTuple):
    """An environment's state, and the reward's memory of the episode."""

    env: Any  # the environment's own state
    memory: Memory


class RewardWrapper(Environment):
    """The environment with the learned reward; its own is `info["task_reward"]` from then on.

    Args:
      boxes: box centres and sizes of the environment's state, in the order of `learned.objects`, in
        the world units of the reward.
      five_values: `step` gives `done` in place of terminated and truncated, as gymnax did before
        1.0 and rejax 0.1 expects.
    """

    def __init__(
        self,
        env: Environment,
        learned: LearnedReward,
        boxes: Callable[[Any], tuple[Float[Array, "N 2"], Float[Array, "N 2"]]],
        *,
        five_values: bool = False,
    ):
        self._env, self._learned, self._boxes = env, learned, boxes
        self._five_values = five_values

    @property
    def default_params(self) -> Any:
        return self._env.default_params

    @partial(jax.jit, static_argnames=("self",))
    def step(self, key: PRNGKeyArray, state: RewardState, action: Any, params: Any = None) -> tuple:
        """Advances one step, with the automatic reset."""
        *moved, reward, terminated, truncated, info = super().step(key, state, action, params)
        ended = (terminated | truncated,) if self._five_values else (terminated, truncated)
        return *moved, reward, *ended, info

    def reset_env(self, key: PRNGKeyArray, params: Any) -> tuple[Any, RewardState]:
        """Starts an episode."""
        observation, state = self._env.reset_env(key, params)
        return observation, RewardState(state, self._learned.init(*self._boxes(state)))

    def step_env(self, key: PRNGKeyArray, state: RewardState, action: Any, params: Any) -> tuple:
        """Advances one step, without the automatic reset."""
        observation, env, task_reward, terminated, info = self._env.step_env(
            key, state.env, action, params
        )
        memory, reward = self._learned.step(state.memory, *self._boxes(env))
        info = {**info, "task_reward": jnp.asarray(task_reward)}
        return observation, RewardState(env, memory), reward, terminated, info

    def is_truncated(self, state: RewardState, params: Any) -> Any:
        return self._env.is_truncated(state.env, params)

    def is_terminated(self, state: RewardState, params: Any) -> Any:
        return self._env.is_terminated(state.env, params)

    def action_space(self, params: Any) -> Any:
        return self._env.action_space(params)

    def observation_space(self, params: Any) -> Any:
        return self._env.observation_space(params)

    @property
    def num_actions(self) -> int:
        return self._env.num_actions

    @property
    def name(self) -> str:
        return self._env.name
