"""A task on the table, a value with a few pure functions, and what a policy observes of it.

The observation: seven joints and the left finger's opening, their rates, the servos' lead over
them; the hand's place and two of its axes; each thing's place from the hand and two of its axes;
the rates of the task's joints; in "rich" the stages that have been reached; the last action.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from gril_jax.envs.panda.kinematics import Frame
from gril_jax.envs.panda.model import DOFS
from gril_jax.envs.stages import Stages
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from .boxes import Boxes
from .physics import Additions, Motion
from .resting import Layout
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
    layout: Layout
    """The things as a picture shows them, so that a frame can be a start."""
    seen: Callable[[View, Boxes], Boxes] = lambda view, things: things
    """(view, boxes) -> boxes of what can be seen of the things, where one hides in another."""
    tilt: float = 0.0
    """By how much the hand leans, rad; see `panda.kinematics.aim`."""
    colours: tuple[tuple[float, float, float], ...] = ()
    """Of the things, RGB from 0 to 1; empty: any."""
    max_contacts: int = 24
    """Most contacts that a substep resolves, unless the environment is told otherwise."""


OBSERVATIONS = ("rich", "plain")
_PLACE = ("x", "y", "z")
_JOINTS = (*(f"joint {i}" for i in range(1, 8)), "opening")


def observe(
    motion: Motion, target: Float[Array, "8"], hand: Frame, things: Boxes,
    reached: Bool[Array, "K"], action: Float[Array, "A"],
) -> Float[Array, "O"]:  # fmt: skip
    """The observation vector; `target` are the servos' aims, `hand` is the tool centre point."""
    robot = motion.qpos[: len(_JOINTS)]
    axes = jnp.concatenate([hand.rotation[:, 1], hand.rotation[:, 2]])
    places = things.position - hand.position
    turns = things.rotation[:, :, :2].swapaxes(1, 2).reshape(len(places), 6)
    return jnp.concatenate([
        robot, motion.qvel[: len(_JOINTS)], target - robot, hand.position, axes,
        jnp.concatenate([places, turns], axis=1).reshape(-1), motion.qvel[DOFS:],
        reached.astype(jnp.float32), action,
    ])  # fmt: skip


def names(
    things: tuple[str, ...], stages: tuple[str, ...], actions: tuple[str, ...], *, rates: int
) -> tuple[str, ...]:
    """The name of each number; `rates` is how many velocities the task's joints have."""
    axes = [f"{axis} axis {p}" for axis in ("x", "y") for p in _PLACE]
    return (
        *_JOINTS, *(f"{j} rate" for j in _JOINTS), *(f"{j} lead" for j in _JOINTS),
        *(f"hand {p}" for p in _PLACE),
        *(f"hand {axis} axis {p}" for axis in ("y", "z") for p in _PLACE),
        *(f"{thing} {what}" for thing in things for what in (*_PLACE, *axes)),
        *(f"rate {i}" for i in range(rates)), *(f"reached {stage}" for stage in stages),
        *(f"last {action}" for action in actions),
    )  # fmt: skip
