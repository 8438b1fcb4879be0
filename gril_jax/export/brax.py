"""A learned reward for environments in the style of brax or MuJoCo Playground.

    env = RewardWrapper(env, load_reward("reward.npz"), boxes)
    env = brax.envs.wrappers.training.wrap(env, episode_length=100)

Neither library is imported: an environment is whatever has `reset(rng)` and `step(state, action)`
with a state of `reward`, `done`, `metrics`, `info` and `replace`, for one episode at a time.

The reward's memory lives in `state.info`, which brax's and Playground's automatic resets do not
reset: they put back the simulator's state and the observation alone, and clear `done` before this
wrapper could see it. Here a new episode is told by `done`, or by the count `info["steps"]` that
brax's and Playground's episode wrappers keep, which is 0 at an episode's first step.
"""

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from gril_jax.errors import ConfigError
from gril_jax.reward.learned_reward import LearnedReward

_KEY = "learned_reward"


@runtime_checkable
class BraxTask(Protocol):
    """An environment in brax's style, for one episode at a time."""

    def reset(self, rng: PRNGKeyArray) -> Any:
        """The first state: with `reward`, `done`, `metrics`, `info` and `replace`."""

    def step(self, state: Any, action: Float[Array, "A"]) -> Any:
        """The next state."""


class RewardWrapper:
    """The environment with the learned reward in place of its own, which becomes a metric.

    Everything else is the environment's. Wrap before it is batched, limited in time or reset.

    Args:
      learned: from `gril_jax.export.reward_file.load_reward`.
      boxes: box centres and sizes of a state, in the order of `learned.objects`, in the world units
        of the reward.
      action_repeat: of the episode wrapper around this one, which counts that many steps once.
    """

    def __init__(
        self,
        env: BraxTask,
        learned: LearnedReward,
        boxes: Callable[[Any], tuple[Float[Array, "N 2"], Float[Array, "N 2"]]],
        *,
        action_repeat: int = 1,
    ):
        self.env, self.learned = env, learned
        self._boxes, self._repeat = boxes, action_repeat

    def reset(self, rng: PRNGKeyArray) -> Any:
        """The first state, with reward 0 as in brax."""
        state = self.env.reset(rng)
        memory = self.learned.init(*self._boxes(state))
        return self._with(state, jnp.zeros_like(state.reward), memory, jnp.zeros((), jnp.int32))

    def step(self, state: Any, action: Float[Array, "A"]) -> Any:
        """The next state, with its learned reward; a ConfigError where an automatic reset hides the
        ends of episodes, since no episode wrapper counts."""
        memory, count = state.info[_KEY]
        new = self._is_new(state, count)
        fresh = self.learned.init(*self._boxes(state))
        memory, count = jax.tree.map(
            lambda x, y: jnp.where(new, x, y), (fresh, jnp.zeros_like(count)), (memory, count)
        )
        state = self.env.step(state, action)
        memory, reward = self.learned.step(memory, *self._boxes(state))
        return self._with(state, reward.astype(state.reward.dtype), memory, count + 1)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name == "env":  # asked of an object that is being copied
            raise AttributeError(name)
        return getattr(self.env, name)

    def _is_new(self, state, count):
        steps = state.info.get("steps")
        if steps is None:
            if any("first_obs" in key for key in state.info):
                raise ConfigError(
                    "an automatic reset surrounds the learned reward, but no episode wrapper does; "
                    "it must be wrapped in one that counts info['steps']."
                )
            return state.done > 0
        # An action that is repeated keeps the count at 0 while it is repeated.
        return (state.done > 0) | ((steps == 0) & (count >= self._repeat))

    def _with(self, state, reward, memory, count):
        return state.replace(
            reward=reward,
            metrics={**state.metrics, "task_reward": state.reward},
            info={**state.info, _KEY: (memory, count)},
        )
