"""The contract of a task: its states, its methods, and the demonstrations of its scripted expert.

Shapes use N for the objects of a scene (goal region and robot included), A for actions and T for
the states of an episode.
"""

from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray, UInt8


class Outline(NamedTuple):
    """One painted polygon of a scene."""

    vertices: np.ndarray  # (V, 2) world units
    fill: tuple[int, int, int]  # RGB, 0 to 255
    rim: tuple[int, int, int] | None  # RGB of the line around it
    width: int = 1  # of that line, in pixels of a 384-pixel picture
    dash: int = 0  # length of its dashes in such pixels; 0 for a whole line


class Objects(NamedTuple):
    """The objects of one frame as a detector would report them, in world units."""

    center: Float[Array, "N 2"]  # centre of mass
    size: Float[Array, "N 2"]  # width and height of the axis-aligned box
    label: Int[Array, "N"]  # index into the task's `classes`
    is_robot: Bool[Array, "N"]


class State(NamedTuple):
    """State of an episode after one step. `step` returns the same structure that `reset` made.

    A task of a user need not give what has a default (`gril_jax.envs.user_tasks.completed`).
    """

    data: Any  # the simulator's state: a pytree that only the task reads
    obs: Float[Array, "O"]
    objects: Objects
    moved: Bool[Array, "N"] | None = None  # objects that a varied start has already moved
    reward: Float[Array, ""] | float = 0.0  # the task's own dense reward of this state
    done: Float[Array, ""] | float = (
        0.0  # 1 if the task itself ended; time limits are the wrapper's
    )
    metrics: Mapping[str, Float[Array, ""]] = MappingProxyType({})  # "score", "success", ...


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


class ExpertError(Exception):
    """A scripted expert cannot show what is wanted; the text is one sentence."""


class Wanted(NamedTuple):
    """Demonstrations to make."""

    successes: int
    failures: int
    seed: int  # of all that is sampled
    places: str  # where things start: "demo", "jitter" (a little elsewhere) or "layout" (anywhere)


class Episode(NamedTuple):
    """One episode of a scripted expert."""

    kind: str  # "success", or how it fails
    outcome: str  # "success" or "failure"
    data: Any  # of the simulator, leaves (T, ...)
    stages: dict[str, int] | None = None  # first frame at which each held; -1 never


class Film(NamedTuple):
    """An episode as a camera and a detector see it."""

    frames: UInt8[np.ndarray, "T P P 3"]
    center: Float[np.ndarray, "T N 2"]
    size: Float[np.ndarray, "T N 2"]
    seen: Bool[np.ndarray, "T N"]


class Demonstrations(NamedTuple):
    """Episodes of a scripted expert, successes first, and how they become boxes."""

    env: Env  # in which they were played
    objects: tuple[str, ...]  # in every one of them
    episodes: list[Episode]
    films: Iterator[Film] | None = None
    """Videos of the episodes in turn; None where a colour detector reads `env.outlines`."""
    robots: tuple[str, ...] | None = None
    """Classes that are parts of the robot; None where their usual names say it."""


Demonstrate = Callable[[Callable[..., Env], Wanted, Callable[[int], None]], Demonstrations]
"""(make, wanted, tell) -> demonstrations: `make` builds the configured task with options changed,
and `tell` hears how many episodes have been played. Raises ExpertError."""
