"""The frame of PPO and SAC: environments, the policy's network, and acting in them with it.

A step has one key. `collect` and `learn` both take it, and split the same `num_keys` from it.
The first key is the next step's. Then come those of new starts, one for each control step, and the
learner's. All are split off at once, because each place that derives keys is a loop to compile.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import jax
from jaxtyping import Array, Float, Key, PRNGKeyArray

from gril_jax.config.encoder import PoolConfig

from . import rollout, starts, training
from .episodes import Environment, Episodes, EpisodeState
from .policy import Policy
from .rewards import AnyReward


@dataclasses.dataclass(frozen=True)
class Sizes:
    """Static options that every algorithm has: they shape the compiled program."""

    num_envs: int
    unroll_length: int
    hidden: tuple[int, ...]
    observe_activity: bool = True
    observe_gradient: bool = False  # with a reward of `reward_gradient.observed`
    window: int = PoolConfig.window  # of the activity memory, frames
    smoothing: int = PoolConfig.smoothing  # of centres, frames, before that
    noise: float | None = PoolConfig.noise  # of centres, world units
    visited_state_resets: float = 0.0  # share of starts at visited states, when training begins
    video_state_resets: float = (
        0.0  # and at frames of videos, with `starts.WithFrames` as parameters
    )


class Agent:
    """One environment and one reward, with networks to act in it.

    Args:
      env: the task.
      reward: what to maximise; its parameters are an argument of `step`.
      static: sizes.
      to_learn: keys that the learner takes in a step.
    """

    networks: Any  # brax's
    _make_policy: Callable[..., Any]

    def __init__(
        self,
        env: Environment,
        reward: AnyReward,
        static: Sizes,
        to_learn: int,
    ):
        self.env = env
        self.num_envs, self.unroll_length = static.num_envs, static.unroll_length
        self.episodes = Episodes.of(
            env, reward, observe_activity=static.observe_activity, window=static.window,
            smoothing=static.smoothing, noise=static.noise,
            chosen_starts=static.visited_state_resets + static.video_state_resets > 0,
        )  # fmt: skip
        self.observation_size = self.episodes.observation_size
        self._renewals = rollout.renewals(static.num_envs, static.unroll_length, env.episode_length)
        self.static = static
        # Keys for starts that training chooses.
        self._choosing = (static.visited_state_resets > 0) + (static.video_state_resets > 0)
        self.num_keys = 1 + self._renewals + static.unroll_length + to_learn + self._choosing

    def step(
        self, state: Any, hyper: Any, reward_params: Any
    ) -> tuple[Any, dict[str, Float[Array, ""]]]:
        """One unroll of every environment, and what is learned from it.

        Args:
          state: of `init`, or of the step before.
          hyper: of the algorithm's type `Hyper`; every number may be traced.
          reward_params: what the reward takes as parameters, any pytree.

        Returns:
          The state after it, and metrics by name, each of shape ().
        """
        return training.step(self, state, hyper, reward_params)

    def act(
        self, policy: Policy, episode: EpisodeState, key: PRNGKeyArray, *,
        deterministic: bool = False,
    ) -> Float[Array, "A"]:  # fmt: skip
        """The policy's action in [-1, 1] in one episode."""
        act = self._make_policy(tuple(policy), deterministic=deterministic)
        return act(self.episodes.observe(episode), key)[0]

    def _begin(self, key: PRNGKeyArray) -> tuple[PRNGKeyArray, PRNGKeyArray, rollout.VectorState]:
        """The key of the first step, one for weights, and environments at random times."""
        keys = jax.random.split(key, 3 + 2 * self.num_envs)
        begun = rollout.init(self.episodes, keys[3:])
        return keys[0], keys[1], rollout.scatter(begun, keys[2], self.env.episode_length)

    def _unroll(
        self, state: Any, key: PRNGKeyArray, act: rollout.Act, hyper: Any, reward_params: Any
    ) -> tuple[Any, rollout.Rollout]:
        """The state after T control steps of every environment, and what they brought."""
        new_starts, each_step, _ = self._split(key)
        choose = functools.partial(self._chosen, state, key, hyper, reward_params)
        renewed = rollout.renew(self.episodes, state.envs, new_starts, choose)
        moved, steps = rollout.unroll(
            self.episodes, reward_params, renewed, act, each_step, tau=hyper.tau
        )
        return state._replace(envs=moved), steps

    def _chosen(
        self, state: Any, key: PRNGKeyArray, hyper: Any, reward_params: Any, fresh: EpisodeState
    ) -> EpisodeState:
        """The fresh starts (R, ...), some of them replaced by video states or visited states."""
        if not self._choosing:
            return fresh
        static, keys = self.static, jax.random.split(key, self.num_keys)
        progress = state.updates / hyper.decay_updates
        if static.video_state_resets:
            share = starts.share_left(static.video_state_resets, progress)
            each = jax.random.split(keys[-1], len(fresh.time))
            fresh = starts.of_videos(self.episodes, reward_params.frames, fresh, each, share=share)
        if static.visited_state_resets:
            share = starts.share_left(static.visited_state_resets, progress)
            fresh = starts.of_own(
                self.episodes,
                reward_params,
                state.envs.running,
                fresh,
                keys[-self._choosing],
                share=share,
            )
        return fresh

    def _split(self, key: PRNGKeyArray) -> tuple[Key[Array, "R"], Key[Array, "T"], Key[Array, "L"]]:
        """Of a step's key those of new starts, of the control steps, and of the learner."""
        keys, acting = jax.random.split(key, self.num_keys), 1 + self._renewals
        learning = acting + self.unroll_length
        learned = len(keys) - self._choosing
        return keys[1:acting], keys[acting:learning], keys[learning:learned]
