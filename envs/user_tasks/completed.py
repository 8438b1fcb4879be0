"""A task of one's own, completed to the whole contract of `gril_jax.envs.Env`.

A user's task must have `classes`, `action_size`, `reset` and `step`, and states with `data`, `obs`,
`objects` and the metric "success". Everything else has a usual value here.
"""

import functools
import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.base import Objects, Outline, State
from jaxtyping import Array, Float, PRNGKeyArray

from .files import TaskError, guarded

USUAL: Mapping[str, Any] = {
    "episode_length": 100, "control_hz": 10.0, "half_extent": 1.0, "background": (255, 255, 255),
}  # fmt: skip

# Tableau's colours, so that neighbouring classes differ.
_COLOURS = (
    (78, 121, 167), (242, 142, 43), (89, 161, 79), (225, 87, 89), (176, 122, 161), (118, 183, 178),
    (237, 201, 72), (156, 117, 95),
)  # fmt: skip


class Shown(NamedTuple):
    """The `data` of a completed task's state: the user's own, and the boxes to be drawn."""

    own: Any
    objects: Objects


class Completed:
    """A user's task with all members of `Env`.

    Its states have the types that training needs: float32, labels of int32, no weak types.
    """

    def __init__(self, task: Any, file: Path):
        self.task, self.file = task, file
        self.classes = tuple(task.classes)
        self.action_size = int(task.action_size)
        for name in USUAL:
            setattr(self, name, member(task, name))
        self.stages = member(task, "stages")
        self.expert = None if member(task, "expert") is None else self._expert
        self.place = None if member(task, "place") is None else self._place
        if hasattr(task, "render"):
            self.render = lambda data, **how: self._own("render", data.own, **how)
        shape = jax.eval_shape(lambda: self.reset(jax.random.key(0)).obs).shape
        self.observation_size = shape[0]

    @functools.cached_property
    def rewarded(self) -> bool:
        """True if the states of `step` have a reward of the task's own."""
        usual, given = State._field_defaults["reward"], []

        def step(key):
            after = self._own("step", self._own("reset", key), jnp.zeros(self.action_size))
            given.append(getattr(after, "reward", usual))

        jax.eval_shape(step, jax.random.key(0))
        return given[0] is not usual

    def reset(self, key: PRNGKeyArray) -> State:
        """Starts a new episode."""
        return complete(self._own("reset", key))

    def step(self, state: State, action: Float[Array, "A"]) -> State:
        """Advances one control step."""
        return complete(self._own("step", state._replace(data=state.data.own), action))

    def outlines(self, data: Shown) -> list[Outline]:
        """The task's own drawing of one state, or its boxes (host side)."""
        if not hasattr(self.task, "outlines"):
            return boxes(data.objects)
        with guarded("outlines", self.file):
            drawn = [Outline(*outline) for outline in self._own("outlines", data.own)]
        if not all(np.ndim(one.vertices) == 2 and np.shape(one.vertices)[1] == 2 for one in drawn):
            raise TaskError(f"{self.file}: outlines must give vertices of the shape (corners, 2)")
        return drawn

    def _expert(self, state: State, key: PRNGKeyArray) -> Float[Array, "A"]:
        """The expert's action; the expert sees the user's own states."""
        action = self._own("expert", state._replace(data=state.data.own), key)
        with guarded("expert", self.file):
            action = jnp.asarray(action, jnp.float32)
        if action.shape != (self.action_size,):
            raise TaskError(
                f"{self.file}: expert returns an action of the shape {action.shape}, but it must "
                f"be ({self.action_size},)"
            )
        return action

    def _place(self, center: Any, size: Any, key: PRNGKeyArray) -> State:
        return complete(self._own("place", center, size, key))

    def _own(self, method: str, *args: Any, **options: Any) -> Any:
        """The answer of the user's method; a TaskError if it fails."""
        with guarded(method, self.file):
            return getattr(self.task, method)(*args, **options)


def member(task: Any, name: str) -> Any:
    """A member of a user's task; the usual one, or None, where there is none. A property that
    fails is no member that is missing."""
    there = inspect.getattr_static(task, name, None) is not None or hasattr(task, name)
    return getattr(task, name) if there else USUAL.get(name)


def complete(state: Any) -> State:
    """A user's state with all fields, in the types that training needs."""
    seen = state.objects
    objects = Objects(
        jnp.asarray(seen.center, jnp.float32), jnp.asarray(seen.size, jnp.float32),
        jnp.asarray(seen.label, jnp.int32), jnp.asarray(seen.is_robot, bool),
    )  # fmt: skip
    metrics = dict(state.metrics)
    metrics = {"score": metrics["success"], **metrics}
    moved = getattr(state, "moved", None)
    none = jnp.zeros(objects.label.shape, bool)
    made = State(
        data=Shown(state.data, objects),
        obs=jnp.asarray(state.obs, jnp.float32),
        objects=objects,
        moved=none if moved is None else jnp.broadcast_to(jnp.asarray(moved, bool), none.shape),
        reward=jnp.asarray(getattr(state, "reward", 0.0), jnp.float32),
        done=jnp.asarray(getattr(state, "done", 0.0), jnp.float32),
        metrics={name: jnp.asarray(value, jnp.float32) for name, value in metrics.items()},
    )
    return jax.tree.map(_strong, made)


def boxes(objects: Objects) -> list[Outline]:
    """Boxes as outlines, a colour for each class; the robot has a dark rim."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
    found = jax.tree.map(np.asarray, objects)
    drawn = []
    # The largest first: a block that lies in its place is to be seen.
    for i in np.argsort(-found.size.prod(axis=1), kind="stable"):
        colour = _COLOURS[int(found.label[i]) % len(_COLOURS)]
        rim = (30, 30, 30) if found.is_robot[i] else tuple(c // 2 for c in colour)
        drawn.append(Outline(found.center[i] + corners * found.size[i], colour, rim))
    return drawn


def _strong(x: Any) -> Any:
    """The array without a weak type; keys have none."""
    x = jnp.asarray(x)
    return x.astype(x.dtype) if getattr(x, "weak_type", False) else x
