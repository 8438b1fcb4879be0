"""Stages as seen in a picture: where a thing's box is, told in sizes of another one's.

A picture has no depth and no grip: a thing that is held before or above another looks as if it were
in it. Tasks say what that means for theirs.
"""

from typing import NamedTuple

import jax.numpy as jnp
from gril_jax.envs.stages import Stage, Stages, free_place
from jaxtyping import Array, Float

ROBOTS = (0, 1, 2)  # left finger, right finger, hand
FIRST = len(ROBOTS)  # the first of the task's own things


class Area(NamedTuple):
    """A rectangle, from the middle of another thing's box and in its sizes."""

    low: tuple[float, float]
    high: tuple[float, float]


def relative(index: int, to: int, center: Float[Array, "N 2"], size: Float[Array, "N 2"]):
    """The middle of one box, from the middle of another one and in its sizes."""
    return (center[index] - center[to]) / size[to]


def corners(area: Area, to: int, center: Float[Array, "N 2"], size: Float[Array, "N 2"]):
    """An area's corners in the picture."""
    return center[to] + jnp.array(area.low) * size[to], center[to] + jnp.array(area.high) * size[to]


def nearest_on(way: Float[Array, "P 2"], place: Float[Array, "2"]):
    """The point of a way of straight pieces that is nearest to a place: its piece, and its share
    along it, from 0 to 1."""
    along = way[1:] - way[:-1]
    share = jnp.sum((place - way[:-1]) * along, axis=1) / jnp.sum(along**2, axis=1)
    share = jnp.clip(share, 0.0, 1.0)
    away = jnp.sum((way[:-1] + share[:, None] * along - place) ** 2, axis=1)
    piece = jnp.argmin(away)
    return piece, share[piece]


def on_rail(thing: int, to: int, way, aside: tuple[float, float]):
    """A `Stages.possible` for a thing that another one guides: it stays about a way, which is told
    from the middle of the other and in its sizes, at most so far aside along each axis.

    A start turns and moves both, so that one way serves all starts but for that much.
    """

    def possible(center: Float[Array, "N 2"], size: Float[Array, "N 2"]) -> Float[Array, "N 2"]:
        points, place = jnp.array(way), relative(thing, to, center, size)
        piece, share = nearest_on(points, place)
        there = points[piece] + share * (points[piece + 1] - points[piece])
        held = there + jnp.clip(place - there, -jnp.array(aside), jnp.array(aside))
        return center.at[thing].set(center[to] + held * size[to])

    return possible


def placed(
    name: str, thing: int, to: int, area: Area, clearly: Area, *, others: tuple[int, ...],
    after: tuple[str, ...] = (),
) -> Stage:  # fmt: skip
    """The stage in which a thing's middle is in an area; it is put clear of the `others`."""

    def holds(center, size):
        place = relative(thing, to, center, size)
        return ((place > jnp.array(area.low)) & (place < jnp.array(area.high))).all()

    def within(center, size):
        return corners(area, to, center, size)

    def place(key, center, size):
        low, high = corners(clearly, to, center, size)
        return free_place(key, thing, center, size, low=low, high=high, others=others)

    return Stage(name, (thing,), holds, place, after, within)


def share_that_holds(task: Stages, center: Float[Array, "N 2"], size: Float[Array, "N 2"]):
    """True progress: the share of the stages that hold, each by itself."""
    held = [stage.holds(center, size) for stage in task.stages]
    return jnp.mean(jnp.stack(held).astype(jnp.float32))


def share_in_order(task: Stages, center: Float[Array, "N 2"], size: Float[Array, "N 2"]):
    """True progress of a task that must be done in order: what comes too early does not count."""
    return jnp.mean(task.done(center, size).astype(jnp.float32))


def share_without_faults(task: Stages, center: Float[Array, "N 2"], size: Float[Array, "N 2"]):
    """The share of the stages that hold, each by itself, with all of it lost over a fault."""
    share = share_that_holds(task, center, size)
    return jnp.where(task.faulty(center, size).any(), 0.0, share)
