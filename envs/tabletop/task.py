"""A task on the table, with its starts and stages: a value with a few pure functions."""

from collections.abc import Callable
from typing import NamedTuple

from gril_jax.envs.panda.frames import Frame
from gril_jax.envs.stages import Stages
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from .boxes import Boxes
from .from_boxes import Layout
from .physics import Additions
from .reward import StageProgress
from .start import Start


class View(NamedTuple):
    """The scene as a task's functions read it."""

    hand: Frame  # of the tool centre point
    pads: Boxes  # of both fingertips, (2, ...)
    joints: Float[Array, "J"]  # positions of the task's joints
    rates: Float[Array, "W"]  # their velocities
    fixtures: Float[Array, "M 7"]  # position and quaternion of what stands still
    reached: Bool[Array, "K"]  # stages that have held at some time of the episode


class Task(NamedTuple):
    """A task's additions to the arm and the table."""

    things: tuple[str, ...]  # names, in the order of `boxes`
    stages: tuple[str, ...]  # names
    scene: Additions
    home: tuple[float, ...]  # the arm's joints at reset
    start: Callable[[PRNGKeyArray, float], Start]  # (key, share of the ranges) -> start
    boxes: Callable[[View], Boxes]  # of the things, (N, ...)
    progress: Callable[[View, Boxes], StageProgress]
    episode_length: int
    by_boxes: Callable[..., Stages]
    """(classes, half_extent=) -> the stages as seen in a picture, for audits of rewards."""
    seen: Callable[[View, Boxes], Boxes] = lambda view, things: things
    """(view, boxes) -> boxes of what can be seen of the things, where one hides in another."""
    tilt: float = 0.0
    """By how much the hand leans, rad; see `panda.kinematics.aim`."""
    colours: tuple[tuple[float, float, float], ...] = ()
    """Of the things, RGB from 0 to 1; empty: any."""
    layout: Layout | None = None
    """The things as a picture shows them; without it no frame can be a start."""
    max_contacts: int = 24
    """Most contacts that a substep resolves, unless the environment is told otherwise."""
