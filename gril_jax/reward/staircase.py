"""The stages of one learned reward: which of them an episode has finished, and what it is paid.

    stairs = staircase.from_levels(shared.level, shared.kept)
    progress = staircase.init()
    progress, r = staircase.step(stairs, progress, latent_goal_reward(params, graph, config))

The reward of a long task climbs in steps, and demonstrations agree on the reward at which each step
ends: that is how stages are discovered (`gril_jax.subtasks.agreement`). So an episode has finished
a stage once its reward is nearly as high.

A stage that follows another never pays less than what demonstrations were paid at the end of that
one, or than when it was entered if that was more. To try things then costs nothing, and to better
what is done already brings next to nothing: were it paid, a policy would stay with it and never
look for what comes next. The whole task is worth its all only if what was done before still holds.
Shapes use M for stages.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

_NEARLY = 0.75  # of the way from the level before: beyond what a mere approach is paid
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
    floor: Float[Array, ""]  # what the present stage pays at least


def init() -> Progress:
    """Progress before an episode's first frame."""
    return Progress(jnp.zeros((), jnp.int32), jnp.full((), _NO_FLOOR))


def from_levels(level: Float[Array, "M"], kept: Bool[Array, "M"]) -> Staircase:
    """A staircase from the rewards at which stages end in the demonstrations, in their order, and
    which of them count; without any, one stage that ends at a reward of 0."""
    order = jnp.argsort(~kept, stable=True)
    some = jnp.any(kept)
    level = jnp.where(some, level[order], 0.0)
    before = jnp.concatenate([jnp.full((1,), _START), level[:-1]])
    least = before + _NEARLY * (level - before)
    return Staircase(least, level, jnp.maximum(jnp.sum(kept), 1))


def step(
    stairs: Staircase, progress: Progress, value: Float[Array, ""]
) -> tuple[Progress, Float[Array, ""]]:
    """The progress after the next frame, and what is paid for it.

    Args:
      stairs: from `from_levels`.
      progress: from `init` before the first frame, then from the previous `step`.
      value: the learned reward of this frame.

    Returns:
      The progress, by at most one stage further and never back, and the reward, or what
      the present stage pays at least if that is more.
    """
    stage = jnp.minimum(progress.index, stairs.count - 1)
    reached = (progress.index < stairs.count) & (value >= stairs.least[stage])
    paid = jnp.maximum(value, progress.floor)
    last = progress.index >= stairs.count - 1  # what follows is no stage of its own
    landing = jnp.maximum(paid, stairs.level[stage])
    floor = jnp.where(reached & ~last, landing, progress.floor)
    return Progress(progress.index + reached.astype(jnp.int32), floor), paid
