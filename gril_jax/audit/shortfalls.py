"""Kinds of shortfall: what a state that is no success lacks.

The first kind of this list that fits is the state's:

    intruder inside   all stages are done, and a fault holds
    just outside      one object, shifted by two margins, would make it a success
    nothing done      true progress is 0
    part missing      one stage is not done, and its objects were never touched
    part undone       one stage is not done, and one of its objects has been touched
    other             anything else

A state counts only if it is clear. In a clear shortfall no single object that is shifted by the
margin, along an axis or along both, makes a success. In a clear success each such shift leaves one.
The margin is two pixels of a picture of the scene that is 96 pixels wide.

Shapes use N for objects, K for stages, W for those that are shifted, and P for places: 8 W + 1.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .scene_reward import Scene, StagedTask
from .states import SUCCESS

KINDS = (
    "nothing done", "part missing", "part undone", "just outside", "intruder inside", "other",
)  # fmt: skip
UNCLEAR = -1  # in place of a kind: a success, or too close to one
_PIXELS, _PICTURE = 2, 96  # the margin, and the width of the picture that it is measured in
_EACH = (-1.0, 0.0, 1.0)
_WAYS = tuple((x, y) for x in _EACH for y in _EACH if x or y)  # along an axis, or along both


def margin(task: StagedTask) -> float:
    """Two pixels of a picture of the scene, in world units."""
    return _PIXELS * 2 * task.half_extent / _PICTURE


def counting(task: StagedTask) -> tuple[int, ...]:
    """The objects whose places can change the score: all but a robot that no stage moves."""
    return tuple(sorted({*task.movable, *(i for stage in task.stages for i in stage.moves)}))


def moved_by_stages(task: StagedTask, count: int) -> Bool[Array, "K N"]:
    """The objects, of so many, that each stage moves."""
    return jnp.array([[i in stage.moves for i in range(count)] for stage in task.stages])


def scores_near(
    task: StagedTask,
    start: Scene,
    center: Float[Array, "N 2"],
    which: Sequence[int] | Int[Array, "W"],
    far: float,
) -> Float[Array, "P"]:
    """True progress as it is, and with each of some objects shifted by `far`, in eight ways."""
    steps = far * jnp.array(_WAYS)
    shift = jax.vmap(lambda i: jax.vmap(lambda step: center.at[i].add(step))(steps))
    moved = shift(jnp.asarray(which)).reshape(-1, *center.shape)
    possible = lambda c: task.progress(task.possible(c, start.size), start.size)  # noqa: E731
    return jax.vmap(possible)(jnp.concatenate([center[None], moved]))


def is_clear_success(
    task: StagedTask, start: Scene, center: Float[Array, "N 2"]
) -> Bool[Array, ""]:
    """True for a success that no shift of one object by the margin ends."""
    return (scores_near(task, start, center, counting(task), margin(task)) >= SUCCESS).all()


def kind_of(
    task: StagedTask, start: Scene, center: Float[Array, "N 2"], active: Bool[Array, "N"]
) -> Int[Array, ""]:
    """The index of a state's kind in KINDS; UNCLEAR for what is no clear shortfall.

    `start` is the scene after the reset, and `active` has the activity bits of the state.
    """
    which = counting(task)
    clear = (scores_near(task, start, center, which, margin(task)) < SUCCESS).all()
    near = scores_near(task, start, center, which, 2 * margin(task))
    missing = ~task.done(center, start.size)
    touched = (moved_by_stages(task, len(center)) & missing[:, None] & active).any()
    fits = {
        "intruder inside": ~missing.any() & task.faulty(center, start.size).any(),
        "just outside": (near >= SUCCESS).any(),
        "nothing done": near[0] <= 0,
        "part missing": (missing.sum() == 1) & ~touched,
        "part undone": (missing.sum() == 1) & touched,
    }
    numbers = [jnp.int32(KINDS.index(name)) for name in fits]
    found = jnp.select([*fits.values()], numbers, KINDS.index("other"))
    return jnp.where(clear, found, UNCLEAR)
