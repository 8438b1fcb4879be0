"""Stages in which things are put somewhere: by the simulator, and as seen in a picture.

In a picture a place is told in sizes of another thing's box. It has no depth and no grip: a thing
that is held before or above another looks as if it were in it. Shapes use N for things.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from gril_jax.envs.panda.kinematics import Frame, into, out_of, rotation
from gril_jax.envs.stages import Stage, Stages, free_place
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
