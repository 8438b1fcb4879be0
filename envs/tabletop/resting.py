"""Things put down where they are seen, and the arm at a hand that is seen, clear of all.

A picture tells places to a few millimetres, so that things may overlap a little, or a wall: they
are moved apart in the plane, and what finds no room beside another thing lies on it. Shapes use N
for things; lengths are metres.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.panda import kinematics
from gril_jax.envs.panda.kinematics import Frame
from jaxtyping import Array, Bool, Float, Int

from . import boxes
from .boxes import Boxes
from .start import Footprint, Start, reach

_PUSHES = 12  # of moving apart
_GAP = 0.001  # metres, from walls and between things
_TOUCH = 0.0005  # metres of overlap that count as lying beside each other
_LIFTS = np.arange(0.0, 0.4, 0.01, np.float32)  # metres, of which the least is taken that is clear
_SEARCH = 6  # of the joints' search
_NEAR = 0.01  # metres: a hand that comes no nearer is out of reach
_AWAY = 50.0  # metres: out of the way of all
_LOWEST = 0.012  # metres: of the tool centre point above the table


class Space(NamedTuple):
    """A floor with walls about it, of a fixture or of what slides along y out of that.

    Without walls, `inside` is `outside`.
    """

    fixture: int
    inside: tuple[float, float]  # half extents between the walls
    outside: tuple[float, float]  # with the walls
    floor: float = 0.0  # height, metres
    slide: int | None = None  # the rail that it goes with


class Rail(NamedTuple):
    """A thing on a hinge or a slide, one joint, whose box shows how far it is open."""

    thing: int
    low: float
    high: float
    tips: float | None  # from there on it falls open, before it shut; None: it stays where it is


class Grip(NamedTuple):
    """A hand that points down or leans as the task's does, and what it holds."""

    place: Float[Array, "3"]  # of the tool centre point, metres
    yaw: Float[Array, ""]
    opening: Float[Array, ""]  # of each finger
    held: Int[Array, ""]  # which loose thing; -1 for none


class Layout(NamedTuple):
    """A task's things as a picture shows them; the joints are those of rails, then of loose ones.

    Loose things come last in the task. Spaces are in the order in which a look from above meets
    them: a thing lies in the first one that it is seen above.
    """

    standing: tuple[int, ...]  # the thing that is each fixture
    loose: tuple[tuple[float, float, float], ...]  # half extents, metres
    spaces: tuple[Space, ...]
    rails: tuple[Rail, ...] = ()
    middle: float = 0.0  # of a loose thing's box, from its origin along its z axis, metres
    grip: float = 0.0  # where it is taken, from that middle along its z axis, metres


def clear(a: Footprint, b: Footprint) -> Float[Array, "2"]:
    """The shortest shift of a thing `a` that brings it clear of `b`; 0 where it is."""
    yaws = jnp.stack([a.place[2], a.place[2] + jnp.pi / 2, b.place[2], b.place[2] + jnp.pi / 2])
    axes = jnp.stack([jnp.cos(yaws), jnp.sin(yaws)], axis=1)
    away = axes @ (a.place[:2] - b.place[:2])
    depth = reach(yaws, a) + reach(yaws, b) - jnp.abs(away)
    least = jnp.argmin(depth)
    way = jnp.where(away[least] < 0, -1.0, 1.0) * axes[least]
    return way * jnp.maximum(depth[least], 0.0)


def over(space: Space, base: Float[Array, "3"], places: Float[Array, "N D"]) -> Bool[Array, "N"]:
    """True for each thing whose middle is above the floor of a space that stands at `base`."""
    return (jnp.abs(_into(base, places[:, :2])) < jnp.array(space.inside)).all(axis=1)


def within(
    spaces: tuple[Space, ...], bases: Float[Array, "S 3"], places: Float[Array, "S N 2"]
) -> Bool[Array, "S N"]:
    """True for each thing in the first space above which it is; places may differ by the space."""
    found, free = [], jnp.ones(places.shape[1], bool)
    for space, base, there in zip(spaces, bases, places, strict=True):
        found.append(free & over(space, base, there))
        free &= ~found[-1]
    return jnp.stack(found) if found else jnp.zeros((0, places.shape[1]), bool)


def put_down(
    places: Float[Array, "N 3"], half: Float[Array, "N 3"], spaces: tuple[Space, ...],
    bases: Float[Array, "S 3"],
) -> tuple[Float[Array, "N 3"], Float[Array, "N"]]:  # fmt: skip
    """Places (x, y, yaw) near the given ones where nothing overlaps, and heights of the middles.

    A thing above the floor of a space comes to lie within its walls, any other is moved out of all;
    `bases` are the places of the spaces. What is in a box with a lid lies below it.
    """
    held = within(spaces, bases, jnp.repeat(places[None, :, :2], len(spaces), axis=0))
    own, outside = jnp.eye(len(places), dtype=bool), ~held.any(axis=0)

    def moved(_, now):
        apart = jnp.where(own[..., None], 0.0, _between(now, half))
        now = now.at[:, :2].add(0.5 * apart.sum(axis=1))
        for space, base, inside in zip(spaces, bases, held, strict=True):
            walled = jax.vmap(_walled, (None, None, 0, 0, 0))(space, base, now, half, inside)
            now = jnp.where((inside | outside)[:, None], walled, now)
        return now

    places = jax.lax.fori_loop(0, _PUSHES, moved, places)
    overlap = jnp.sqrt(jnp.sum(_between(places, half) ** 2, axis=-1)) > _TOUCH + _GAP
    floors = jnp.array([space.floor for space in spaces]) @ held if spaces else jnp.zeros(len(half))
    heights: list[Array] = []
    for i in range(len(places)):  # what found no room lies on those before it
        tops = [jnp.where(overlap[i, j], heights[j] + half[j, 2], 0.0) for j in range(i)]
        heights.append(jnp.max(jnp.stack([floors[i], *tops])) + half[i, 2])
    return places, jnp.stack(heights)


def _between(places: Float[Array, "N 3"], half: Float[Array, "N 3"]) -> Float[Array, "N N 2"]:
    """Shifts that bring each thing clear of each other one, by the gap."""
    things = Footprint(places, half[:, :2] + _GAP / 2)
    return jax.vmap(jax.vmap(clear, in_axes=(None, 0)), in_axes=(0, None))(things, things)


def _walled(space: Space, base, place, half, inside) -> Float[Array, "3"]:
    """The place of one thing, kept between the walls of a space or out of them."""
    local = _into(base, place[:2])
    thing = Footprint(place, half[:2])
    across = reach(base[2] + jnp.array([0.0, jnp.pi / 2]), thing)
    room = jnp.maximum(jnp.array(space.inside) - across - _GAP, 0.0)
    kept = jnp.clip(local, -room, room)
    out = clear(thing, Footprint(base, jnp.array(space.outside) + _GAP))
    c, s = jnp.cos(base[2]), jnp.sin(base[2])
    within = base[:2] + jnp.stack([c * kept[0] - s * kept[1], s * kept[0] + c * kept[1]])
    return place.at[:2].set(jnp.where(inside, within, place[:2] + out))


def _into(base: Float[Array, "3"], points: Float[Array, "*N 2"]) -> Float[Array, "*N 2"]:
    """Points of the plane in the frame of what stands at a place."""
    away, c, s = points - base[:2], jnp.cos(base[2]), jnp.sin(base[2])
    return jnp.stack(
        [c * away[..., 0] + s * away[..., 1], c * away[..., 1] - s * away[..., 0]], axis=-1
    )


def hand_at(
    home: Float[Array, "7"],
    start: Start,
    grip: Grip,
    layout: Layout,
    things: Callable[[Array, Array], Boxes],
    tilt: float,
) -> tuple[Start, Float[Array, "7"], Bool[Array, ""]]:
    """The start with what is held lifted as far as the hand, the arm, and whether it gets there.

    The hand goes no further down than to where it, and what it holds, touch nothing. Spaces with
    walls are hollow, and what is held above the floor of one may touch these.
    """
    all_things = things(start.joints, start.fixtures)
    first, count = len(all_things.half) - len(layout.loose), len(layout.loose)
    is_held = jnp.arange(len(all_things.half)) == jnp.where(grip.held < 0, -1, first + grip.held)
    known = jnp.isfinite(grip.place).all() & jnp.isfinite(grip.yaw)
    place = jnp.where(known, grip.place, jnp.array([0.5, 0.0, 0.4]))
    place = place.at[2].max(_LOWEST)
    turn = kinematics.pointing(jnp.where(known, grip.yaw, 0.0), tilt)
    solid, mine = _hollow(all_things, layout, is_held)

    def clear(lift):
        up = jnp.zeros(3).at[2].set(lift)
        hand = Frame(place + up - kinematics.TCP * turn[:, 2], turn)
        robot = boxes.robot(hand, grip.opening, grip.opening)
        moved = all_things._replace(position=all_things.position + up)
        touches = jax.vmap(jax.vmap(boxes.touching, in_axes=(None, 0)), in_axes=(0, None))
        by_held = touches(moved, solid) & is_held[:, None] & ~mine
        held = jnp.arange(len(solid.half)) == jnp.argmax(is_held)
        return ~((touches(robot, solid) & ~(held & is_held.any())).any() | by_held.any())

    free = jax.vmap(clear)(jnp.asarray(_LIFTS))
    lift = jnp.asarray(_LIFTS)[jnp.argmax(free)]
    goal = Frame(place.at[2].add(lift), turn)
    arm = jax.lax.fori_loop(0, _SEARCH, lambda _, q: kinematics.reach(q, goal, rest=home), home)
    near = jnp.linalg.norm(kinematics.tcp(arm).position - goal.position) < _NEAR
    known &= near & free.any()
    rails = len(layout.rails)
    held = jnp.arange(count) == grip.held
    loose = start.joints[rails:].reshape(count, 7)
    loose = loose.at[:, 2].add(jnp.where(held, lift, 0.0))
    joints = jnp.concatenate([start.joints[:rails], loose.reshape(-1)])
    return start._replace(joints=joints), arm, known


def _hollow(things: Boxes, layout: Layout, is_held: Bool[Array, "N"]) -> tuple[Boxes, Array]:
    """The things, four walls in the place of each with a space, and a mask of those that may be
    touched by what is held: itself, and the walls about it."""
    parts, mine = [things], [is_held]
    middle = jnp.sum(jnp.where(is_held[:, None], things.position, 0.0), axis=0)
    for space in layout.spaces:
        if space.slide is not None or space.inside == space.outside:
            continue
        thing = layout.standing[space.fixture]
        whole = Boxes(*(x[thing] for x in things))
        parts[0] = parts[0]._replace(position=parts[0].position.at[thing].add(_AWAY))
        parts.append(_walls(space, whole))
        inside = jnp.abs(kinematics.into(Frame(whole.position, whole.rotation), middle))[:2]
        mine.append(jnp.repeat((inside < jnp.array(space.inside)).all(), 4))
    return Boxes(*(jnp.concatenate(x) for x in zip(*parts, strict=True))), jnp.concatenate(mine)


def _walls(space: Space, whole: Boxes) -> Boxes:
    """The four walls of what has a space, by the box about it."""
    (x, y), (a, b) = space.inside, space.outside
    ways = np.array([(a + x, 0, 0), (-a - x, 0, 0), (0, b + y, 0), (0, -b - y, 0)], np.float32)
    thick = np.array([((a - x), 2 * b)] * 2 + [(2 * a, b - y)] * 2, np.float32)
    rotation = jnp.repeat(whole.rotation[None], 4, axis=0)
    position = whole.position + kinematics.turned(rotation, jnp.asarray(ways / 2))
    height = jnp.full((4, 1), whole.half[2])
    return Boxes(position, rotation, jnp.concatenate([thick / 2, height], axis=1))
