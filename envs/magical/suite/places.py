"""Places of a start: the Demo layout's, near them, anywhere, or where boxes lie.

One entity is placed after another: regions, robot, blocks, and last the blocks that belong in a
region. Each takes the first of 128 uniform poses at which it touches no wall and nothing placed
before; if none is free the layout is begun anew, at most ten times. Blocks count as polygons beside
each other, but stars, and all beside anything else, as circles: a little stricter than MAGICAL's.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.magical import layout as layouts
from gril_jax.envs.magical.layout import Places, first_free, gap_to_region, radii, rim, turned
from gril_jax.envs.planar import shapes
from gril_jax.envs.planar.contacts import frames
from gril_jax.envs.planar.plane import Vec, fence
from gril_jax.envs.planar.robots import Robot
from gril_jax.envs.planar.shapes import NOTHING, SHAPES
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from .plan import OUTSIDE, Kinds, Plan, outside
from .state import Order

_CANDIDATES, _LAYOUTS = 128, 10  # poses that are sampled for each, layouts that are begun at most
_STAR = shapes.SHAPES.index("star")
_NEAR = np.array([0.025, 0.025, 0.05 * np.pi], np.float32)  # most that Jitter changes a pose by
_SIDE = 0.0075  # and a region's width or height


class _Standing(NamedTuple):
    """The things that stand already."""

    regions: Float[Array, "R 4"]
    robot: Float[Array, "V 2"]  # points around it
    blocks: Float[Array, "B 3"]
    shape: Int[Array, "B"]  # `NOTHING` for those that do not stand yet


def demo(plan: Plan, slots: int) -> Places:
    """The Demo layout."""
    poses = [b.pose for b in plan.blocks] + [outside(b) for b in range(len(plan.blocks), slots)]
    boxes = [region.box() for region in plan.regions]
    return Places(
        jnp.array(plan.robot),
        jnp.array(poses).reshape(-1, 3),
        jnp.array(boxes, jnp.float32).reshape(-1, 4),
        jnp.zeros((), bool),
    )


def draw(
    key: PRNGKeyArray, plan: Plan, kinds: Kinds, robot: Robot, *, arena: float, anywhere: bool
) -> Places:
    """A layout near Demo's, or `anywhere`. Without a place for something it is begun anew."""
    each = functools.partial(_draw, plan, kinds, robot, arena=arena, anywhere=anywhere)

    def drawn(state):
        return state[0] + 1, each(jax.random.fold_in(key, state[0]))

    again = lambda state: (state[0] < _LAYOUTS) & state[1].unplaced  # noqa: E731
    none = demo(plan, len(kinds.shape))._replace(unplaced=jnp.ones((), bool))
    begun = jnp.zeros((), jnp.int32), none
    return jax.lax.while_loop(again, drawn, begun)[1]


def _draw(plan: Plan, kinds: Kinds, robot: Robot, key: PRNGKeyArray, *, arena, anywhere) -> Places:
    """One layout, which may lack a place for something."""
    key_regions, key_robot, key_blocks = jax.random.split(key, 3)
    shape, known = jnp.asarray(kinds.shape), demo(plan, len(kinds.shape))
    spread = np.array([arena, arena, np.pi], np.float32) if anywhere else _NEAR
    regions, unplaced = _regions(key_regions, plan, kinds, known.regions, spread, arena, anywhere)
    around = jnp.asarray(rim(robot))

    def outline(pose):
        return turned(pose[..., None, 2], around) + pose[..., None, :2]

    def stands(poses):
        points = outline(poses)
        free = (jnp.abs(points) < arena).all(axis=(1, 2))
        for region in regions:
            free &= (gap_to_region(points, region) > 0).all(axis=1)
        return free

    middle = jnp.zeros(3) if anywhere else known.robot
    pose, free = _first(key_robot, lambda unit: middle + spread * unit, stands, 3)
    begun = _Standing(regions, outline(pose), known.blocks, jnp.full_like(shape, NOTHING))
    if not len(shape):
        return Places(pose, known.blocks, regions, unplaced | ~free)
    homes = [-1 if block.home is None else block.home for block in plan.blocks]
    homes = np.array(homes + [-1] * (len(shape) - len(homes)))
    order = np.argsort(homes >= 0, kind="stable")  # those with a home come last

    def place(standing: _Standing, one):
        key, slot, home = one
        center, reach = _aim(plan, known.blocks[slot], home, regions, spread, anywhere)
        clear = lambda poses: _clear(poses, shape[slot], standing, home, arena)  # noqa: E731
        pose, free = _first(key, lambda unit: center + reach * unit, clear, 3)
        there = shape[slot] != NOTHING
        pose = jnp.where(there, pose, known.blocks[slot].at[0].set(OUTSIDE))
        blocks = standing.blocks.at[slot].set(pose)
        standing = standing._replace(blocks=blocks, shape=standing.shape.at[slot].set(shape[slot]))
        return standing, there & ~free

    slots = jax.random.split(key_blocks, len(shape)), jnp.array(order), jnp.array(homes[order])
    standing, failed = jax.lax.scan(place, begun, slots)
    return Places(pose, standing.blocks, regions, unplaced | ~free | failed.any())


def _first(
    key: PRNGKeyArray, made: Callable[[Array], Array], clear: Callable[[Array], Array], size: int
) -> tuple[Float[Array, "_"], Bool[Array, ""]]:
    """The first of the poses made of uniform numbers in [-1, 1] that is clear, and True; if none
    is, the first of all and False."""
    poses = made(jax.random.uniform(key, (_CANDIDATES, size), minval=-1.0))
    return first_free(poses, clear)


def _regions(key, plan: Plan, kinds: Kinds, known, spread, arena: float, anywhere: bool):
    """Regions clear of walls and each other, and True if one is not."""
    placed, unplaced = jnp.zeros((0, 4)), jnp.zeros((), bool)
    for r, there in enumerate(kinds.region_there):
        key_side, key_place = jax.random.split(jax.random.fold_in(key, r))
        low, high = (jnp.full(2, side) for side in plan.sides)
        if not anywhere:
            low = jnp.maximum(low, known[r, 2:] - _SIDE)
            high = jnp.minimum(high, known[r, 2:] + _SIDE)
        side = jax.random.uniform(key_side, (2,), minval=low, maxval=high)
        corner = known[r, :2] + known[r, 2:] * jnp.array([-0.5, 0.5])  # which stays where it is
        middle = jnp.zeros(2) if anywhere else corner + side * jnp.array([0.5, -0.5])

        def clear(places, side=side, placed=placed):
            free = (jnp.abs(places) + side / 2 < arena).all(axis=1)
            apart = jnp.abs(places[:, None] - placed[:, :2]) > (side + placed[:, 2:]) / 2
            return free & apart.any(axis=2).all(axis=1)

        made = lambda unit, middle=middle: middle + spread[:2] * unit  # noqa: E731
        place, free = _first(key_place, made, clear, 2)
        gone = jnp.array([*outside(r)[:2], 0.0, 0.0])
        box = jnp.where(there, jnp.concatenate([place, side]), gone)
        placed, unplaced = jnp.concatenate([placed, box[None]]), unplaced | (there & ~free)
    return placed, unplaced


def _aim(plan: Plan, pose, home: Int[Array, ""], regions, spread, anywhere: bool):
    """The middle of a block's poses and how far they reach from it: about its home's middle, or
    for a block without one (home -1) anywhere, or near its Demo pose."""
    own = jnp.zeros(3) if anywhere else pose
    if not len(regions):
        return own, spread
    region, turn = regions[home], 0.0 if anywhere else pose[2]
    room = jnp.min(region[2:]) / 2 - plan.margin if anywhere else spread[0]
    within = jnp.append(region[:2], turn), jnp.stack([room, room, spread[2]])
    return jnp.where(home < 0, own, within[0]), jnp.where(home < 0, spread, within[1])


def _clear(poses, shape, standing: _Standing, home: Int[Array, ""], arena: float):
    """True for poses at which a block touches nothing but the region that is its home."""
    places, radius = poses[:, :2], radii(shape)
    free = (jnp.abs(places) + radius < arena).all(axis=1)
    apart = jnp.sum((places[:, None] - standing.robot) ** 2, axis=-1)
    free &= apart.min(axis=1) > radius**2
    for r, region in enumerate(standing.regions):
        free &= (gap_to_region(places, region) > radius) | (home == r)
    far = jnp.sum((places[:, None] - standing.blocks[:, :2]) ** 2, axis=-1)
    far = far > (radius + radii(standing.shape)) ** 2
    # Arms of stars may cross although no corner of the one lies in the other.
    star = (shape == _STAR) | (standing.shape == _STAR)
    touching = _gaps(poses, shape, standing) <= 0
    return free & ~(~far & (star | touching) & (standing.shape != NOTHING)).any(axis=1)


def _gaps(poses: Float[Array, "C 3"], shape: Int[Array, ""], standing: _Standing):
    """Distances (C, B) of a block's corners, at each pose, from each block that stands, or of its
    corners from the first; the smaller, negative where one lies inside."""
    own, others = shapes.blocks(shape[None]), shapes.blocks(standing.shape)
    at, theirs = frames(poses), frames(standing.blocks)
    there = jax.tree.map(lambda f: f[:, None], at)  # (C, 1), beside (B,)
    corners = Vec(own.corners.x[:, None], own.corners.y[:, None]).out_of(there.heading)
    corners = (corners + there.center - theirs.center).into(theirs.heading)  # (5, C, B)
    one = _beyond(others, fence(corners)) - own.radius
    here = jax.tree.map(lambda f: f[:, None], theirs)  # (B, 1), beside (C,)
    corners = Vec(others.corners.x[..., None], others.corners.y[..., None]).out_of(here.heading)
    corners = (corners + here.center - at.center).into(at.heading)  # (5, B, C)
    two = jnp.swapaxes(_beyond(own, fence(corners)), 1, 2) - others.radius
    return jnp.minimum(one.min(axis=0), two.min(axis=0))


def _beyond(polygon: shapes.BlockShape, point: Vec) -> Float[Array, "..."]:
    """Distances of points beyond the faces of polygons, or from circles; in their frames."""
    faces = [polygon.directions[k].dot(point) for k in range(5)]
    beyond = functools.reduce(jnp.maximum, faces) - polygon.rim_start.x
    circle = polygon.rim_start.x == 0
    return jnp.where(circle, jnp.sqrt(point.dot(point)), beyond) - polygon.radius


def renamed(key: PRNGKeyArray, kinds: Kinds, *, colours: bool, shapes: bool) -> Kinds:
    """The same things, every colour and every shape replaced by another one, or by itself."""
    key_colour, key_shape = jax.random.split(key)
    if colours:
        to = jax.random.permutation(key_colour, len(layouts.COLOURS)).astype(jnp.int32)
        kinds = kinds._replace(colour=to[kinds.colour], region_colour=to[kinds.region_colour])
    if shapes:
        to = jax.random.permutation(key_shape, len(SHAPES)).astype(jnp.int32)
        there = kinds.shape != NOTHING
        kinds = kinds._replace(shape=jnp.where(there, to[kinds.shape % len(SHAPES)], kinds.shape))
    return kinds


def moved(
    key: PRNGKeyArray, boxes: Float[Array, "N 4"], there: Bool[Array, "N"], *, arena: float
) -> Float[Array, "N 4"]:
    """The boxes turned by quarters, mirrored and moved as one, all of them that are `there` within
    the walls where they were before."""
    key_turn, key_mirror, key_shift = jax.random.split(key, 3)
    center, size = boxes[:, :2], boxes[:, 2:]
    quarters = jax.random.randint(key_turn, (), 0, 4)
    across = jnp.where(jax.random.bernoulli(key_mirror), -1.0, 1.0)
    cosine, sine = jnp.array([1.0, 0.0, -1.0, 0.0]), jnp.array([0.0, 1.0, 0.0, -1.0])
    c, s, x, y = cosine[quarters], sine[quarters], across * center[:, 0], center[:, 1]
    center = jnp.stack([c * x - s * y, s * x + c * y], axis=1)
    size = jnp.where(quarters % 2 == 1, size[:, ::-1], size)
    low = jnp.min(jnp.where(there[:, None], center - size / 2, arena), axis=0)
    high = jnp.max(jnp.where(there[:, None], center + size / 2, -arena), axis=0)
    least, most = jnp.minimum(-arena - low, 0.0), jnp.maximum(arena - high, 0.0)
    shift = jax.random.uniform(key_shift, (2,), minval=least, maxval=most)
    return jnp.concatenate([center + shift, size], axis=1)


def placed(
    key: PRNGKeyArray, boxes: Float[Array, "N 4"], kinds: Kinds, listed: Order, robot: Robot,
    *, arena: float,
) -> layouts.Places:  # fmt: skip
    """Everything where its box lies, robot, regions and blocks in the order of `listed`.

    Boxes do not show angles, which are sampled; a robot that could not stand at one of those, as
    one that holds a block, stands as near as it can. Blocks that are not there lie outside.
    """
    key_angle, key_there, key_robot = jax.random.split(key, 3)
    count = len(listed.regions)
    regions = jnp.zeros((count, 4)).at[listed.regions].set(boxes[1 : 1 + count])
    shown = boxes[1 + count :, :2]
    angle = jax.random.uniform(key_angle, (len(shown), 1), minval=-jnp.pi, maxval=jnp.pi)
    blocks = jnp.zeros((len(shown), 3))
    blocks = blocks.at[listed.blocks].set(jnp.concatenate([shown, angle], axis=1))
    away = jnp.array([outside(b) for b in range(len(shown))]).reshape(-1, 3)
    blocks = jnp.where((kinds.shape == NOTHING)[:, None], away, blocks)
    radii, keys = jnp.asarray(layouts.RADII)[kinds.shape], (key_there, key_robot)
    stands = layouts.stand(keys, robot, blocks, radii, arena=arena, at=boxes[0, :2])
    return layouts.Places(stands, blocks, regions, jnp.zeros((), bool))
