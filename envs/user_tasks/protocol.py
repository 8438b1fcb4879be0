"""The contract of a task of one's own, as far as a second or two shows it, before every work.

`episodes` plays, too, and says in sentences what only that shows.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.base import State
from gril_jax.envs.stages import Stages

from .completed import Completed, complete, member
from .files import FAILURES, TaskError, fault, guarded

_MOST = {"action_size": 1_000, "episode_length": 100_000}  # numbers; steps: at 10 Hz 2.8 hours
_MEMORY = 1 << 24  # numbers in a state: thousands are stepped together


def completed(task: Any, file: Path) -> Completed:
    """The user's task with all members of the contract; a TaskError of one sentence for the first
    thing that is missing or wrong."""
    for check in (_members, _state, _step, _place, _numbers):
        with guarded(f"the task, a {type(task).__name__},", file):
            said = check(task, file)
        if said:
            raise TaskError(f"{file}: {said}")
    return Completed(task, file)


def _members(task: Any, file: Path) -> str | None:
    """A sentence if an attribute is missing or not of its kind."""
    for name in ("classes", "action_size", "reset", "step"):
        if not hasattr(task, name):
            return f"the task, a {type(task).__name__}, has no `{name}`"
    classes = task.classes
    if isinstance(classes, str) or not _names(classes):
        return f"classes is {classes!r:.80}, but must be a tuple of different, printable names"
    for name, most in _MOST.items():
        value = member(task, name)
        whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
        if not (whole and 1 <= value <= most):
            return f"{name} is {value!r:.40}, but must be a whole number from 1 to {most:,}"
    for name in ("control_hz", "half_extent"):
        value = member(task, name)
        number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
        if not (number and 0 < value < 1e6):
            return f"{name} is {value!r:.40}, but must be a number above 0, and below a million"
    return _optional(task)


def _optional(task: Any) -> str | None:
    """A sentence if a member that need not be there is not of its kind."""
    for name in ("reset", "step", "expert", "place", "outlines", "render"):
        if (method := member(task, name)) is not None and not callable(method):
            return f"{name} is a {type(method).__name__}, but must be a function"
    colour, stages = member(task, "background"), member(task, "stages")
    if np.shape(colour) != (3,) or not all(isinstance(c, int) and 0 <= c <= 255 for c in colour):
        return f"background is {colour!r:.60}, but must be three whole numbers from 0 to 255"
    if stages is not None and not isinstance(stages, Stages):
        return f"stages is a {type(stages).__name__}, but must be of gril_jax.envs.stages"
    return None


def _names(classes: Any) -> bool:
    try:
        names = tuple(classes)
    except TypeError:
        return False
    written = all(type(n) is str and n.strip() and n.isprintable() for n in names)
    return bool(names) and written and len({*names}) == len(names)


def _state(task: Any, file: Path) -> str | None:
    """A sentence if `reset` cannot be traced, or its state is not as it must be."""
    try:
        state = jax.eval_shape(task.reset, jax.random.key(0))
    except FAILURES as error:
        return f"reset fails as JAX compiles it ({fault(error, file)})"
    return _shapes(state, "reset")


def _shapes(state: Any, method: str) -> str | None:
    """A sentence if a state lacks a field, or one is of another shape or type."""
    for name in ("data", "obs", "objects", "metrics"):
        if not hasattr(state, name):
            return f"{method} returns a {type(state).__name__} without `{name}`"
    for name in ("center", "size", "label", "is_robot"):
        if not hasattr(state.objects, name):
            return f"{method} returns objects without `{name}`"
    if said := _boxes(state.objects, method):
        return said
    moved, count = getattr(state, "moved", None), np.shape(state.objects.center)[:1]
    if moved is not None and np.shape(moved) not in ((), count):
        return f"{method}: moved has the shape {np.shape(moved)}, but must be {count}"
    if len(np.shape(state.obs)) != 1 or not np.size(state.obs):
        shape = np.shape(state.obs)
        return f"{method}: obs has the shape {shape}, but must be a vector of at least 1 number"
    if not isinstance(state.metrics, Mapping) or "success" not in state.metrics:
        return f"{method}: metrics has no 'success', 1 where the task is done and 0 elsewhere"
    numbers = {name: getattr(state, name, 0.0) for name in ("reward", "done")}
    for name, value in {**numbers, **state.metrics}.items():
        if np.shape(value) != ():
            return f"{method}: {name} has the shape {np.shape(value)}, but must be one number"
    if (count := sum(map(np.size, jax.tree.leaves(state)))) > _MEMORY:
        return f"{method}: a state holds {count:,} numbers, but at most {_MEMORY:,} are possible"
    return None


def _boxes(objects: Any, method: str) -> str | None:
    """A sentence if the arrays of the objects are of other shapes or types."""
    center = np.shape(objects.center)
    if len(center) != 2 or center[1] != 2 or not center[0]:
        return f"{method}: objects.center has the shape {center}, but must be (objects, 2)"
    wanted = {"size": center, "label": center[:1], "is_robot": center[:1]}
    for name, shape in wanted.items():
        found = np.shape(getattr(objects, name))
        if found != shape:
            return f"{method}: objects.{name} has the shape {found}, but must be {shape}"
    for name, kinds in {"label": "iu", "is_robot": "biu"}.items():
        found = getattr(objects, name).dtype
        if found.kind not in kinds:
            must = "whole numbers" if name == "label" else "True or False"
            return f"{method}: objects.{name} is {found}, but must be {must}"
    return None


def _step(task: Any, file: Path) -> str | None:
    """A sentence if `step` cannot be traced, or gives another structure than `reset`."""

    def both(key, action):
        first = task.reset(key)
        whole = complete(first)
        after = task.step(whole._replace(data=whole.data.own), action)
        return whole, after

    action = jnp.zeros(task.action_size)
    try:
        first, after = jax.eval_shape(both, jax.random.key(0), action)
    except FAILURES as error:
        return f"step fails as JAX compiles it ({fault(error, file)})"
    return _alike(first, after, "step")


def _place(task: Any, file: Path) -> str | None:
    """A sentence if there is a `place` that gives another structure than `reset`."""
    if (place := member(task, "place")) is None:
        return None

    def both(key):
        whole = complete(task.reset(key))
        return whole, place(whole.objects.center, whole.objects.size, key)

    try:
        first, after = jax.eval_shape(both, jax.random.key(0))
    except FAILURES as error:
        return f"place fails as JAX compiles it ({fault(error, file)})"
    return _alike(first, after, "place")


def _alike(first: State, after: Any, method: str) -> str | None:
    """A sentence if a method's state is of other shapes or types than that of `reset`."""
    if said := _shapes(after, method):
        return said
    after = jax.eval_shape(complete, after)
    if jax.tree.structure(first) != jax.tree.structure(after):
        return (
            f"{method} returns another structure than reset: the same fields must be in both states"
        )
    pairs = zip(jax.tree.leaves_with_path(first), jax.tree.leaves(after), strict=True)
    for (path, a), b in pairs:
        if (a.shape, a.dtype) != (b.shape, b.dtype):
            return (
                f"state{jax.tree_util.keystr(path).replace('.own', '')} is {a.dtype} {a.shape} "
                f"after reset and {b.dtype} {b.shape} after {method}, but must be the same"
            )
    return None


def _numbers(task: Any, file: Path) -> str | None:
    """A sentence if the first two states hold what they must not."""
    whole = Completed(task, file)
    action = jnp.zeros(task.action_size)
    try:
        first = jax.jit(whole.reset)(jax.random.key(0))
        states = {"reset": first, "step": jax.jit(whole.step)(first, action)}
    except FAILURES as error:
        return f"an episode cannot be begun ({fault(error, file)})"
    for method, state in states.items():
        if (bad := not_finite(state)) is not None:
            return f"{method} gives a state with NaN or infinity in {bad}"
        label = np.asarray(state.objects.label)
        if label.min() < 0 or label.max() >= len(whole.classes):
            wrong = label.max() if label.min() >= 0 else label.min()
            return (
                f"{method}: objects.label has {int(wrong)}, but must be from 0 to "
                f"{len(whole.classes) - 1}, an index into classes"
            )
        if (np.asarray(state.objects.size) <= 0).any():
            return f"{method}: objects.size must be above 0, for a box has a width and a height"
        if np.asarray(state.objects.is_robot).all():
            return f"{method}: objects.is_robot is True for all, but some object must be another's"
    return None


def not_finite(state: State) -> str | None:
    """The first leaf with a number that is not finite, as `state.obs`; None if there is none."""
    for path, leaf in jax.tree.leaves_with_path(state):
        floats = jnp.issubdtype(leaf.dtype, jnp.floating)
        if floats and not np.isfinite(np.asarray(leaf, np.float64)).all():
            return f"state{jax.tree_util.keystr(path).replace('.own', '')}"
    return None
