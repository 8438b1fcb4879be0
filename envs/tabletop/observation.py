"""Observations of a tabletop scene, and the name of each number.

Seven joints and the left finger's opening, their rates, the servos' lead over them; the hand's
place and two of its axes; each thing's place from the hand and two of its axes; the rates of the
task's joints; in "rich" the stages that have been reached, of which "plain" says nothing; the last
action. Units: rad, metres, seconds.
"""

import jax.numpy as jnp
from gril_jax.envs.panda.frames import Frame
from gril_jax.envs.panda.model import DOFS
from jaxtyping import Array, Bool, Float

from .boxes import Boxes
from .physics import Motion

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
