"""Stages of one learned reward, and a floor under each stage that is finished.

    stairs = staircase.from_levels(shared.level, shared.kept)
    progress = staircase.init()
    progress, r = staircase.step(stairs, progress, latent_goal_reward(params, graph, config))

The reward of a long task climbs in steps, and demonstrations agree on the reward at which each step
ends (`gril_jax.subtasks.agreement`). An episode has finished a stage once its reward is nearly as
high. In the next stage the reward never drops below the level at which demonstrations end the one
before, nor below its value on entry. The next sub-policy can then explore safely, and gains nothing
by standing still. The last stage has no floor of its own: the task's full reward requires that
earlier stages still hold. Shapes use M for stages.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

_NEARLY = 0.75  # of the way from the level before: above the reward of a mere approach
_START = -1.0  # the reward of demonstrations' first frames, by its scale
_NO_FLOOR = -1e6  # in the first stage; finite, as all that an episode remembers must be


class Staircase(NamedTuple):
    """Stages in order."""

    least: Float[Array, "M"]  # the reward at which a stage is finished
    level: Float[Array, "M"]  # the reward at which it ends in the demonstrations
    count: Int[Array, ""]  # how many stages there are; the rest is padding


class Progress(NamedTuple):
    """State of an episode's stages, to be reset when the episode ends."""

    index: Int[Array, ""]  # stages finished; `count` when all are
    floor: Float[Array, ""]  # least reward in the present stage


def init() -> Progress:
    """Progress before an episode's first frame."""
    return Progress(jnp.zeros((), jnp.int32), jnp.full((), _NO_FLOOR))


def from_levels(level: Float[Array, "M"], kept: Bool[Array, "M"]) -> Staircase:
    """Stages from the rewards at which demonstrations end them, and a mask of those that count.

    The rewards are in order. If no stage counts, there is one, which ends at a reward of 0."""
    order = jnp.argsort(~kept, stable=True)
    some = jnp.any(kept)
    level = jnp.where(some, level[order], 0.0)
    before = jnp.concatenate([jnp.full((1,), _START), level[:-1]])
    least = before + _NEARLY * (level - before)
    return Staircase(least, level, jnp.maximum(jnp.sum(kept), 1))


def step(
    stairs: Staircase, progress: Progress, value: Float[Array, ""]
) -> tuple[Progress, Float[Array, ""]]:
    """The progress after the next frame, and its reward.

    Args:
      stairs: from `from_levels`.
      progress: from `init` before the first frame, then from the previous `step`.
      value: the learned reward of this frame.

    Returns:
      The progress, by at most one stage further and never back, and the reward or the present
      stage's floor, whichever is higher.
    """
    stage = jnp.minimum(progress.index, stairs.count - 1)
    reached = (progress.index < stairs.count) & (value >= stairs.least[stage])
    reward = jnp.maximum(value, progress.floor)
    last = progress.index >= stairs.count - 1  # what follows is no stage of its own
    level = jnp.maximum(reward, stairs.level[stage])
    floor = jnp.where(reached & ~last, level, progress.floor)
    return Progress(progress.index + reached.astype(jnp.int32), floor), reward
