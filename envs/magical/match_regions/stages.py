"""The stages of MatchRegions: each target in the region; its faults: each distractor in it.

Objects are region, robot, targets, distractors, in that order. The score is the task's own, which
counts centres; a block that is put into the region is put wholly inside.
"""

import jax.numpy as jnp
from gril_jax.envs.magical.match_regions import score as rewards
from gril_jax.envs.stages import Stage, Stages, free_place
from jaxtyping import Array, Bool, Float, PRNGKeyArray

__all__ = ["REGION", "ROBOT", "stages"]

REGION, ROBOT, _FIRST = 0, 1, 2


def stages(targets: tuple[str, ...], distractors: tuple[str, ...], *, arena: float) -> Stages:
    """The stages of the task with these blocks in an arena |x|, |y| <= `arena`."""
    movable = tuple(range(_FIRST, _FIRST + len(targets) + len(distractors)))

    def inside(block: int, name: str) -> Stage:
        return Stage(f"{name} in the region", (block,), _holds(block), _place(block, movable))

    made = [inside(_FIRST + i, name) for i, name in enumerate((*targets, *distractors))]
    return Stages(
        stages=tuple(made[: len(targets)]),
        faults=tuple(made[len(targets) :]),
        movable=movable,
        robots=(ROBOT,),
        half_extent=arena,
        score=_score,
    )


def _holds(block: int):
    def holds(center: Float[Array, "N 2"], size: Float[Array, "N 2"]) -> Bool[Array, ""]:
        return (jnp.abs(center[block] - center[REGION]) <= size[REGION] / 2).all()

    return holds


def _place(block: int, movable: tuple[int, ...]):
    def place(
        key: PRNGKeyArray, center: Float[Array, "N 2"], size: Float[Array, "N 2"]
    ) -> Float[Array, "N 2"]:
        room = jnp.maximum(size[REGION] - size[block], 0.0) / 2
        low, high = center[REGION] - room, center[REGION] + room
        return free_place(key, block, center, size, low=low, high=high, others=movable)

    return place


def _score(task: Stages, center: Float[Array, "N 2"], size: Float[Array, "N 2"]):
    inside = jnp.concatenate([task.done(center, size), task.faulty(center, size)])
    unused = jnp.zeros(len(task.stages))
    return rewards.score(rewards.Progress(inside, unused, unused, unused, unused))
