"""The stages of MatchRegions: each target in the region; its faults: each distractor in it.

Objects are region, robot, targets, distractors, in that order. The score is the task's own, which
counts centres; a block that is put into the region is put wholly inside.
"""

import jax.numpy as jnp
from gril_jax.envs.magical.match_regions import score as rewards
from gril_jax.envs.stages import Stage, Stages, free_place
from jaxtyping import Array, Float

REGION, ROBOT, _FIRST = 0, 1, 2


def stages(targets: tuple[str, ...], distractors: tuple[str, ...], *, arena: float) -> Stages:
    """The stages of the task with these blocks in an arena |x|, |y| <= `arena`."""
    movable = tuple(range(_FIRST, _FIRST + len(targets) + len(distractors)))

    made = [_inside(i, name, movable) for i, name in enumerate((*targets, *distractors), _FIRST)]
    done, wrong = tuple(made[: len(targets)]), tuple(made[len(targets) :])
    return Stages(
        done, faults=wrong, movable=movable, robots=(ROBOT,), half_extent=arena, score=_score
    )


def _inside(block: int, name: str, movable: tuple[int, ...]) -> Stage:
    def holds(center, size):
        return (jnp.abs(center[block] - center[REGION]) <= size[REGION] / 2).all()

    def place(key, center, size):
        room = jnp.maximum(size[REGION] - size[block], 0.0) / 2
        low, high = center[REGION] - room, center[REGION] + room
        return free_place(key, block, center, size, low=low, high=high, others=movable)

    return Stage(f"{name} in the region", (block,), holds, place)


def _score(task: Stages, center: Float[Array, "N 2"], size: Float[Array, "N 2"]):
    inside = jnp.concatenate([task.done(center, size), task.faulty(center, size)])
    unused = jnp.zeros(len(task.stages))
    return rewards.score(rewards.Progress(inside, unused, unused, unused, unused))
