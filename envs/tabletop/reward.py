"""Progress of a tabletop task in K stages: when each was reached, success, and the task's rewards.

  "staged"  (k + rho) / K with k stages done and progress rho within the next, in [0, 1); once an
            episode 1 for each number of stages reached and 5 for success; minus 0.01 |change of
            action|^2. The pattern is that of ManiSkill's normalised dense rewards, with bonuses
  "stages"  k / K
  "sparse"  1 while the episode is successful, else 0

Success means that the task's condition holds in 5 frames in a row, 50 ms (a control step) apart.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

_SUSTAINED = 5  # frames, the reset being one
_SUCCESS_BONUS, _CHANGE_COST = 5.0, 0.01


class StageProgress(NamedTuple):
    """The progress of a task in one frame."""

    done: Bool[Array, "K"]  # the stages that hold now
    within: Float[Array, ""]  # progress in the next one, from 0 to 1
    finished: Bool[Array, ""]  # the condition of success holds now


class Record(NamedTuple):
    """The memory of an episode's progress."""

    stage_time: Int[Array, "K"]  # control steps after which each stage first held; -1 not yet
    held: Int[Array, ""]  # frames in a row with the condition of success
    best: Int[Array, ""]  # most stages done at once; K + 1 after success

    @property
    def success(self) -> Bool[Array, ""]:
        return self.held >= _SUSTAINED

    @property
    def reached(self) -> Bool[Array, "K"]:
        """True for each stage that has held at some time."""
        return self.stage_time >= 0


def closeness(a: Float[Array, "3"], b: Float[Array, "3"]) -> Float[Array, ""]:
    """1 - tanh(5 distance): 1 at distance 0, 0.24 at 20 cm."""
    return 1.0 - jnp.tanh(5.0 * jnp.sqrt(jnp.sum((a - b) ** 2) + 1e-12))


def no_record(stages: int) -> Record:
    """The record of an episode in which nothing has been seen yet."""
    zero = jnp.zeros((), jnp.int32)
    return Record(jnp.full(stages, -1, jnp.int32), zero, zero)


def record(before: Record, progress: StageProgress, time: Int[Array, ""]) -> Record:
    """The record after a control step that ended at `time`."""
    fresh = progress.done & ~before.reached
    held = jnp.where(progress.finished, before.held + 1, 0)
    count = jnp.sum(progress.done, dtype=jnp.int32)
    count = jnp.where(held >= _SUSTAINED, len(progress.done) + 1, count)
    stage_time = jnp.where(fresh, time, before.stage_time)
    return Record(stage_time, held, jnp.maximum(before.best, count))


def reward(
    name: str, before: Record, after: Record, progress: StageProgress, change: Float[Array, "A"]
) -> Float[Array, ""]:
    """The reward of a control step between two records, `change` that of its action.

    `name` is one of `REWARDS`; `progress` is that after the step.
    """
    stages, count = len(progress.done), jnp.sum(progress.done, dtype=jnp.int32)
    if name == "sparse":
        return after.success.astype(jnp.float32)
    if name == "stages":
        return count / stages
    rest = jnp.where(count < stages, progress.within, 0.0)
    bonus = lambda best: jnp.minimum(best, stages) + _SUCCESS_BONUS * (best > stages)  # noqa: E731
    gained = bonus(after.best) - bonus(before.best)
    return (count + rest) / stages + gained - _CHANGE_COST * jnp.sum(change**2)
