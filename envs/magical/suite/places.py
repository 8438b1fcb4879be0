"""Places of a start: the Demo layout's, near them, or anywhere.

One entity is placed after another: regions, robot, blocks, and last the blocks that belong in a
region. Each takes the first of some uniform poses at which it touches no wall and nothing placed
before, regions included; if none is free the first, and the episode says so. Blocks count as their
bounding circles, which is a little stricter than MAGICAL's exact test.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.magical.layout import gap_to_region, radii, rim, turned
from gril_jax.envs.planar.robots import Robot
from gril_jax.envs.planar.shapes import NOTHING
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from .plan import Kinds, Plan, outside

_CANDIDATES = 128
_NEAR = np.array([0.025, 0.025, 0.05 * np.pi], np.float32)  # most that Jitter changes a pose by
_SIDE = 0.0075  # and a region's width or height


class Places(NamedTuple):
    """Where everything starts."""

    robot: Float[Array, "3"]
    blocks: Float[Array, "B 3"]
    regions: Float[Array, "R 4"]  # centre x, y; width, height
    unplaced: Bool[Array, ""]  # something found no free place


class _Placed(NamedTuple):
    """What stands already."""

    regions: list[Array]
    robot: Float[Array, "V 2"] | None  # points around it
    circles: list[tuple[Array, Array]]  # centres and radii of blocks


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
    """A layout near Demo's, or `anywhere`."""
    slots, known = len(kinds.shape), demo(plan, len(kinds.shape))
    keys = jax.random.split(key, len(plan.regions) + 1 + slots)
    placed, unplaced = _Placed([], None, []), jnp.zeros((), bool)
    for r, there in enumerate(kinds.region_there):
        box, free = _region(keys[r], plan, known.regions[r], placed, arena, anywhere)
        gone = jnp.array([*outside(r)[:2], 0.0, 0.0])
        placed.regions.append(jnp.where(there, box, gone))
        unplaced |= there & ~free
    key_robot, *keys = keys[len(plan.regions) :]
    pose, free = _robot(key_robot, robot, known.robot, placed, arena, anywhere)
    placed = placed._replace(robot=turned(pose[2], jnp.asarray(rim(robot))) + pose[:2])
    unplaced |= ~free
    size, blocks = radii(jnp.asarray(kinds.shape)), [*known.blocks]
    homes = [block.home for block in plan.blocks] + [None] * (slots - len(plan.blocks))
    for b in sorted(range(slots), key=lambda b: homes[b] is not None):
        there = kinds.shape[b] != NOTHING
        poses = _poses(keys[b], known.blocks[b], homes[b], plan, placed, arena, anywhere)
        clear = _clear(poses, size[b], placed, homes[b], arena)
        blocks[b] = jnp.where(there, poses[jnp.argmax(clear)], jnp.array(outside(b)))
        placed.circles.append((blocks[b][:2], size[b]))
        unplaced |= there & ~clear.any()
    stack = lambda rows, n: jnp.stack(rows) if rows else jnp.zeros((0, n))  # noqa: E731
    return Places(pose, stack(blocks, 3), stack(placed.regions, 4), unplaced)


def _unit(key: PRNGKeyArray, *shape: int) -> Array:
    return jax.random.uniform(key, shape, minval=-1.0)


def _spread(arena: float, anywhere: bool) -> Float[np.ndarray, "3"]:
    return np.array([arena, arena, np.pi], np.float32) if anywhere else _NEAR


def _region(key, plan: Plan, box, placed: _Placed, arena: float, anywhere: bool):
    """A region clear of walls and other regions, and whether there is one."""
    key_side, key_place = jax.random.split(key)
    low, high = plan.sides
    side = (low + high + (high - low) * _unit(key_side, 2)) / 2
    if not anywhere:
        low, high = jnp.maximum(low, box[2:] - _SIDE), jnp.minimum(high, box[2:] + _SIDE)
        side = (low + high + (high - low) * _unit(key_side, 2)) / 2
    corner = box[:2] + box[2:] * jnp.array([-0.5, 0.5])
    middle = 0.0 if anywhere else corner + side * jnp.array([0.5, -0.5])
    places = middle + _spread(arena, anywhere)[:2] * _unit(key_place, _CANDIDATES, 2)
    free = (jnp.abs(places) + side / 2 < arena).all(axis=1)
    for other in placed.regions:
        free &= (jnp.abs(places - other[:2]) > (side + other[2:]) / 2).any(axis=1)
    return jnp.concatenate([places[jnp.argmax(free)], side]), free.any()


def _robot(key, robot: Robot, pose, placed: _Placed, arena: float, anywhere: bool):
    """A pose of the robot, as a rigid whole with open fingers, and whether it is free."""
    poses = _spread(arena, anywhere) * _unit(key, _CANDIDATES, 3)
    poses = poses if anywhere else pose + poses
    points = turned(poses[:, None, 2], jnp.asarray(rim(robot))) + poses[:, None, :2]
    free = (jnp.abs(points) < arena).all(axis=(1, 2))
    for region in placed.regions:
        free &= (gap_to_region(points, region) > 0).all(axis=1)
    return poses[jnp.argmax(free)], free.any()


def _poses(key, pose, home: int | None, plan: Plan, placed: _Placed, arena: float, anywhere: bool):
    """Poses to choose from, for a block of its own or in its home."""
    unit, spread = _unit(key, _CANDIDATES, 3), _spread(arena, anywhere)
    if home is None:
        return spread * unit if anywhere else pose + spread * unit
    region = placed.regions[home]
    room = jnp.min(region[2:]) / 2 - plan.margin if anywhere else spread[0]
    places = region[:2] + room * unit[:, :2]
    angle = (0.0 if anywhere else pose[2]) + spread[2] * unit[:, 2:]
    return jnp.concatenate([places, angle], axis=1)


def _clear(poses, radius, placed: _Placed, home: int | None, arena: float) -> Bool[Array, "C"]:
    places = poses[:, :2]
    free = (jnp.abs(places) + radius < arena).all(axis=1)
    apart = jnp.sum((places[:, None] - placed.robot) ** 2, axis=-1)
    free &= apart.min(axis=1) > radius**2
    for r, region in enumerate(placed.regions):
        if r != home:
            free &= gap_to_region(places, region) > radius
    for center, other in placed.circles:
        free &= jnp.sum((places - center) ** 2, axis=1) > (radius + other) ** 2
    return free
