"""Episodes of one environment: activity memory, time limit, guard against NaN, automatic reset.

An `EpisodeState` holds everything that must be forgotten when an episode ends, so that a reset is
the choice between two of them. All functions take one; batch with `jax.vmap`, or see
`gril_jax.rl.rollout`.
"""

import dataclasses
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from gril_jax.config.encoder import PoolConfig
from gril_jax.graphs import activity

from .rewards import AnyReward, Reward, as_reward


@runtime_checkable
class Environment(Protocol):
    """A task as pure functions of its state, which has at least `obs`, `objects`, `moved`,
    `reward`, `done` and `metrics` (see `gril_jax.envs.base.State`)."""

    action_size: int
    episode_length: int  # control steps

    def reset(self, key: PRNGKeyArray) -> Any: ...

    def step(self, state: Any, action: Float[Array, "A"]) -> Any: ...


class EpisodeState(NamedTuple):
    """Episode state of one environment."""

    state: Any  # the environment's own state
    memory: activity.Memory
    reward_memory: Any  # what the reward remembers, a pytree
    time: Int[Array, ""]  # control steps since the episode began
    varied: Any = ()  # 1 if training chose where it began, 0 if the task did; () if it always does


class StepResult(NamedTuple):
    """Result of one control step."""

    reward: Float[Array, ""]
    terminated: Float[Array, ""]  # the task ended: nothing more to gain
    truncated: Float[Array, ""]  # time limit or failure ended the episode: its value goes on
    nonfinite: Float[Array, ""]  # the simulator failed, and the step was taken back
    metrics: dict[str, Float[Array, ""]]  # the task's, after the step


@dataclasses.dataclass(frozen=True)
class Episodes:
    """The episodes of one task under one reward: `begin`, `advance` and `observe`, all pure."""

    env: Environment
    reward: Reward
    observe_activity: bool = True
    """True if the policy sees the activity bits, as the reward does."""
    window: int = PoolConfig.window
    """Window of the activity memory, frames."""
    smoothing: int = PoolConfig.smoothing
    """Frames of the running median of centres, applied first."""
    noise: float | None = PoolConfig.noise
    """Standard deviation of a centre along one axis, world units."""
    chosen_starts: bool = False
    """True if training may choose where episodes begin (`gril_jax.rl.starts`): they then say it."""

    @classmethod
    def of(cls, env: Environment, reward: AnyReward, **options: Any) -> "Episodes":
        """Makes it from a plain reward or one with a memory."""
        return cls(env, as_reward(reward), **options)

    @property
    def observation_size(self) -> int:
        """Size of the policy's observation."""
        episode = jax.eval_shape(lambda: self.begin(jax.random.key(0)))
        return jax.eval_shape(self.observe, episode).shape[0]

    def begin(self, key: PRNGKeyArray) -> EpisodeState:
        """The start of an episode; active is only what a varied start has moved.

        The key is consumed.
        """
        state = self.env.reset(key)
        return self.started(state, state.moved)

    def started(self, state: Any, active: Bool[Array, "N"]) -> EpisodeState:
        """The start of an episode in a state of the task, with these objects active."""
        center = state.objects.center
        memory = activity.init(center, window=self.window, smoothing=self.smoothing)
        memory = memory._replace(active=active)
        varied = jnp.zeros(()) if self.chosen_starts else ()
        return EpisodeState(state, memory, self.reward.init(), jnp.zeros((), jnp.int32), varied)

    def can_begin(self, episode: EpisodeState) -> Bool[Array, ""]:
        """True if no number that the policy would see at this start is NaN or infinite.

        What else is not finite is found by the first step, which is then undone.
        """
        return jnp.isfinite(self.observe(episode)).all()

    def advance(
        self,
        reward_params: Any,
        episode: EpisodeState,
        action: Float[Array, "A"],
        *,
        tau: Float[Array, ""] | float,
    ) -> tuple[EpisodeState, StepResult]:
        """One control step; the state it returns is the last of its episode if a flag says so.

        A step with a non-finite result is undone and cuts the episode off, so that one
        broken simulation does not reach the weights of all. It does not end the task: else a
        policy whose reward is never positive would learn to break the simulator.

        Actions are in [-1, 1]; `tau` is the activity threshold, in box diagonals.
        """
        state = self.env.step(episode.state, action)
        boxes = state.objects.center, state.objects.size
        memory, active = activity.step(episode.memory, *boxes, tau=tau, noise=self.noise)
        remembered, reward = self.reward.step(reward_params, episode.reward_memory, state, active)
        moved = EpisodeState(state, memory, remembered, episode.time + 1, episode.varied)
        finite = _all_finite((state, remembered, reward))
        moved = jax.tree.map(lambda new, old: jnp.where(finite, new, old), moved, episode)
        terminated = jnp.where(finite, state.done, 0.0)
        limit = (episode.time + 1 >= self.env.episode_length).astype(jnp.float32)
        over = jnp.where(finite, limit, 1.0)
        result = StepResult(
            reward=jnp.where(finite, reward, 0.0),
            terminated=terminated,
            truncated=over * (1 - terminated),
            nonfinite=1.0 - finite.astype(jnp.float32),
            metrics=self._metrics(moved),
        )
        return moved, result

    def _metrics(self, episode: EpisodeState) -> dict[str, Float[Array, ""]]:
        """The task's metrics, and whether training chose where the episode began."""
        metrics = dict(episode.state.metrics)
        if self.chosen_starts:
            metrics["varied"] = jnp.maximum(metrics.get("varied", 0.0), episode.varied)
        return metrics

    def observe(self, episode: EpisodeState) -> Float[Array, "O"]:
        """The policy's input: the task's observation, and whatever else the reward depends on."""
        remembered = self.reward.observe(episode.reward_memory)
        if not self.observe_activity:
            return jnp.concatenate([episode.state.obs, remembered])
        bits = episode.memory.active.astype(jnp.float32)
        return jnp.concatenate([episode.state.obs, bits, remembered])


def reset_where(ended: Bool[Array, ""], fresh: EpisodeState, episode: EpisodeState) -> EpisodeState:
    """The fresh episode if this one has ended, else this one: memory and all."""
    return jax.tree.map(lambda new, old: jnp.where(ended, new, old), fresh, episode)


def _all_finite(tree: Any) -> Bool[Array, ""]:
    floats = [x for x in jax.tree.leaves(tree) if jnp.issubdtype(x.dtype, jnp.floating)]
    return jnp.stack([jnp.isfinite(x).all() for x in floats]).all()
