"""One environment's episodes: activity memory, time limit, guard against NaN, automatic reset.

A `Lane` holds everything that must be forgotten when an episode ends, so that a reset is the choice
between two lanes. All functions take one lane; batch with `jax.vmap`.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from .. import activity
from .rewards import RewardFn

__all__ = ["Lane", "Moment", "advance", "begin", "observe", "reset_where"]


class Lane(NamedTuple):
    """One environment in the middle of an episode."""

    state: Any  # the environment's own state
    memory: activity.Memory
    time: Int[Array, ""]  # control steps since the episode began


class Moment(NamedTuple):
    """What one control step brought."""

    reward: Float[Array, ""]
    terminated: Float[Array, ""]  # the task ended: nothing more to gain
    truncated: Float[Array, ""]  # time limit or failure ended the episode: its value goes on
    nonfinite: Float[Array, ""]  # the simulator failed, and the step was taken back
    metrics: dict[str, Float[Array, ""]]  # the task's, at this moment


def begin(env: Any, key: PRNGKeyArray, *, window: int, smoothing: int = 1) -> Lane:
    """A lane at the start of an episode; active is only what a varied start has moved.

    The key is consumed.
    """
    state = env.reset(key)
    memory = activity.init(state.objects.center, window=window, smoothing=smoothing)
    return Lane(state, memory._replace(active=state.moved), jnp.zeros((), jnp.int32))


def advance(
    env: Any,
    reward_fn: RewardFn,
    reward_params: Any,
    lane: Lane,
    action: Float[Array, "A"],
    *,
    tau: Float[Array, ""] | float,
    noise: float | None = None,
) -> tuple[Lane, Moment]:
    """One control step; the lane it returns is the last of its episode if a flag says so.

    A step that yields anything not finite is taken back and cuts the episode off, so that one
    broken simulation does not reach the weights of all. It is no end of the task: a policy whose
    reward is never positive would learn to break the simulator if nothing were to come after it.
    """
    state = env.step(lane.state, action)
    boxes = state.objects.center, state.objects.size
    memory, active = activity.step(lane.memory, *boxes, tau=tau, noise=noise)
    reward = reward_fn(reward_params, state, active)
    floats = [x for x in jax.tree.leaves((state, reward)) if jnp.issubdtype(x.dtype, jnp.floating)]
    finite = jnp.stack([jnp.isfinite(x).all() for x in floats]).all()
    moved = Lane(state, memory, lane.time + 1)
    moved = jax.tree.map(lambda new, old: jnp.where(finite, new, old), moved, lane)
    terminated = jnp.where(finite, state.done, 0.0)
    limit = (lane.time + 1 >= env.episode_length).astype(jnp.float32)
    over = jnp.where(finite, limit, 1.0)
    moment = Moment(
        reward=jnp.where(finite, reward, 0.0),
        terminated=terminated,
        truncated=over * (1 - terminated),
        nonfinite=1.0 - finite.astype(jnp.float32),
        metrics=moved.state.metrics,
    )
    return moved, moment


def observe(lane: Lane, *, activity_bits: bool) -> Float[Array, "O"]:
    """The policy's input: the task's observation, then what else the reward depends on."""
    if not activity_bits:
        return lane.state.obs
    return jnp.concatenate([lane.state.obs, lane.memory.active.astype(jnp.float32)])


def reset_where(ended: Bool[Array, ""], fresh: Lane, lane: Lane) -> Lane:
    """The fresh lane if the episode has ended, else the lane itself: memory and all."""
    return jax.tree.map(lambda new, old: jnp.where(ended, new, old), fresh, lane)
