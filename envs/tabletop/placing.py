"""Stages in which things are put somewhere and let go: when one holds, and progress to the next.

Shapes use N for the things that are to be put; lengths are metres.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from gril_jax.envs.panda.frames import Frame, into, out_of, rotation
from jaxtyping import Array, Bool, Float

from .boxes import Boxes, box, free, lowest, touching
from .reward import StageProgress, closeness
from .task import View

SLOW = 0.05  # m/s
_OFF = 0.005  # a thing this far off the ground is held


class Spot(NamedTuple):
    """A place for things: a box in a frame, and the point of it to which they are carried."""

    frame: Frame
    low: tuple[float, float, float]  # of a thing's centre, in the frame
    high: tuple[float, float, float]
    goal: tuple[float, float, float] | Float[Array, "N 3"]  # in the frame; of all, or of each


def at(spot: Spot, position: Float[Array, "*N 3"]) -> Bool[Array, "*N"]:
    """True for a thing's centre within the spot."""
    place = into(spot.frame, position)
    return ((place > jnp.array(spot.low)) & (place < jnp.array(spot.high))).all(axis=-1)


def fixture(view: View, index: int) -> Frame:
    """The frame of something that stands still."""
    return Frame(view.fixtures[index, :3], rotation(view.fixtures[index, 3:]))


def frees(poses: Float[Array, "M"], halves: tuple[tuple[float, ...], ...]) -> list[Boxes]:
    """Boxes about the origins of things with a free joint each, from all of their positions."""
    return [
        box(Frame(pose[:3], rotation(pose[3:])), (0.0, 0.0, 0.0), half)
        for pose, half in zip(poses.reshape(-1, 7), halves, strict=True)
    ]


def speeds(rates: Float[Array, "W"]) -> Float[Array, "N"]:
    """Speeds of things with a free joint each, from all of their rates, m/s."""
    return jnp.sqrt(jnp.sum(rates.reshape(-1, 6)[:, :3] ** 2, axis=1))


def picked(boxes: Boxes, first: int, count: int) -> Boxes:
    """Some of the boxes, in a row."""
    return Boxes(*(x[first : first + count] for x in boxes))


def released(view: View, things: Boxes) -> Bool[Array, "N"]:
    """True for each thing that no fingertip touches."""
    return jax.vmap(functools.partial(free, view.pads))(things)


def held(view: View, thing: Boxes, *, ground: Float[Array, ""] | float = 0.0) -> Bool[Array, ""]:
    """True if both fingertips touch a thing that is off the ground, which is at that height."""
    gripped = jax.vmap(touching, in_axes=(0, None))(view.pads, thing).all()
    return gripped & (lowest(thing) > ground + _OFF)


def carrying(
    view: View, things: Boxes, spot: Spot, inside: Bool[Array, "N"], done: Bool[Array, "N"],
    distance: Float[Array, "N"], *, ground: Float[Array, ""] | float = 0.0,
) -> Float[Array, ""]:  # fmt: skip
    """Progress of the thing that is nearest by `distance` among those that are not done.

    A fifth each for reaching it, holding it off the ground and letting it go inside, two fifths for
    its way to the goal; where it is inside, the way is done.
    """
    current = jnp.argmin(jnp.where(done, jnp.inf, distance))
    thing = Boxes(*(x[current] for x in things))
    goals = jnp.broadcast_to(jnp.array(spot.goal), things.position.shape)
    goal = out_of(spot.frame, goals[current])
    gripped = held(view, thing, ground=ground).astype(jnp.float32)
    way = jnp.where(inside[current], 1.0, gripped * closeness(thing.position, goal))
    return (
        0.2 * closeness(view.hand.position, thing.position)
        + 0.2 * gripped + 0.4 * way + 0.2 * inside[current]
    )  # fmt: skip


def put(
    view: View, things: Boxes, speed: Float[Array, "N"], spot: Spot,
    *, ground: Float[Array, ""] | float = 0.0,
) -> StageProgress:  # fmt: skip
    """Progress of a task, or of its end, in which all things are to be put into one spot.

    A stage a thing: it is inside and released. It is finished when all are and hardly move.
    """
    inside = at(spot, things.position)
    done = inside & released(view, things)
    away = jnp.sum((things.position - spot.frame.position)[:, :2] ** 2, axis=1)
    within = carrying(view, things, spot, inside, done, away, ground=ground)
    return StageProgress(done, within, (done & (speed < SLOW)).all())
