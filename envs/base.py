"""The contract of a task: what it hands out, and what every learner may rely on.

Shapes use N for the objects of a scene (goal region and robot included) and A for actions.
"""

from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

__all__ = ["Env", "Objects", "Outline", "State"]


class Outline(NamedTuple):
    """One painted polygon of a scene."""

    vertices: np.ndarray  # (V, 2) world units
    fill: tuple[int, int, int]  # RGB, 0 to 255
    rim: tuple[int, int, int] | None  # RGB of the line around it
    width: int = 1  # of that line, in pixels of a 384-pixel picture
    dash: int = 0  # length of its dashes in such pixels; 0 for a whole line


class Objects(NamedTuple):
    """What a detector would report of one frame, in world units."""

    center: Float[Array, "N 2"]  # centre of mass
    size: Float[Array, "N 2"]  # width and height of the axis-aligned box
    label: Int[Array, "N"]  # index into the task's `classes`
    is_robot: Bool[Array, "N"]


class State(NamedTuple):
    """One moment of an episode. `step` returns the same structure that `reset` made."""

    data: Any  # the simulator's state: a pytree that only the task reads
    obs: Float[Array, "O"]
    objects: Objects
    moved: Bool[Array, "N"]  # objects that a varied start has already moved
    reward: Float[Array, ""]  # the task's own dense reward of this moment
    done: Float[Array, ""]  # 1 if the task itself ended; time limits are the wrapper's
    metrics: dict[str, Float[Array, ""]]  # "score", "success", ...


@runtime_checkable
class Env(Protocol):
    """A task. Pure: `step` builds a new state, `reset` uses its key once."""

    classes: tuple[str, ...]  # names that `Objects.label` indexes
    observation_size: int
    action_size: int
    episode_length: int  # control steps until the time limit
    control_hz: float
    half_extent: float  # half the width of the world that a picture of the scene shows
    background: tuple[int, int, int]  # RGB around the scene

    def reset(self, key: PRNGKeyArray) -> State: ...

    def step(self, state: State, action: Float[Array, "A"]) -> State: ...

    def outlines(self, data: Any) -> list[Outline]: ...  # of one state's `data`, on the host
