"""Starts of MatchRegions: those that a variant draws, and varied ones for training."""

import jax
import jax.numpy as jnp
from gril_jax.envs.magical import layout as layouts
from gril_jax.envs.magical.layout import Places
from gril_jax.envs.magical.suite.in_regions import MatchRegions as MagicalTask
from gril_jax.envs.magical.suite.places import demo
from gril_jax.envs.magical.suite.plan import Block, Plan
from gril_jax.envs.planar.robots import Robot
from jaxtyping import Array, Bool, Float, Key, PRNGKeyArray

DEMO = MagicalTask.plan
DEMO_BLOCKS = {block.name: block for block in DEMO.blocks}

_CANDIDATES = 16
_ASIDE = 0.15  # arena units, standard deviation of a block's place from the straight way


def plan(blocks: tuple[str, ...]) -> Plan:
    """The Demo start with these blocks; one that it does not have is at the origin, and must be put
    elsewhere. The region has the colour of the first."""
    made = tuple(DEMO_BLOCKS.get(name, Block(name, (0.0, 0.0, 0.0))) for name in blocks)
    region = DEMO.regions[0]._replace(colour=blocks[0].split()[0])
    return DEMO._replace(blocks=made, regions=(region,), slots=None)


def places(
    key: PRNGKeyArray,
    variant: str,
    plan: Plan,
    *,
    robot: Robot,
    radii: Float[Array, "B"],
    arena: float,
) -> Places:
    """The places of a start: the Demo layout's, near them, or anywhere."""
    if variant in ("layout", "all"):
        return layouts.scatter(key, robot, radii, arena=arena)
    start = demo(plan, len(plan.blocks))
    return layouts.jitter(key, start, arena=arena) if variant == "jitter" else start


def varied(
    keys: Key[Array, "2"],
    at: Places,
    *,
    share: float,
    on_the_way: float,
    facing: float,
    targets: int,
    robot: Robot,
    radii: Float[Array, "B"],
    arena: float,
) -> tuple[Places, Bool[Array, ""], Bool[Array, "B"]]:
    """A start that in a `share` of the episodes has the robot anywhere and targets further on.

    Two times in three one target is in the region, unless it is the only one and may be on its way.
    Each other target is somewhere on its way there with probability `on_the_way`, so that some
    episodes have little left to do. With probability `facing` the robot is not anywhere but before
    a target that is not in the region.
    The first `targets` blocks are the targets. Returns also whether the start was varied, and the
    blocks that were.
    """
    never = jnp.zeros(len(radii), bool)
    if not share:
        return at, jnp.zeros((), bool), never
    vary = jax.random.uniform(keys[0]) < share
    key_robot, key_some, key_which, key_where = jax.random.split(keys[1], 4)
    which = jax.random.randint(key_which, (), 0, targets, jnp.int32)
    several = targets > 1 or not on_the_way  # a single one in it leaves nothing to learn
    some = vary & (jax.random.uniform(key_some) < 2 / 3) & several
    unit = jax.random.uniform(key_where, (3,), minval=-1.0)
    goal = at.regions[0]
    inside = jnp.concatenate([goal[:2] + 0.35 * goal[2:] * unit[:2], jnp.pi * unit[2:]])
    blocks = jnp.where(some, at.blocks.at[which].set(inside), at.blocks)
    moved = never.at[which].set(some)
    for target in range(targets if on_the_way else 0):
        key_use, key_way = jax.random.split(jax.random.fold_in(key_where, target))
        pose, free = _on_its_way(key_way, target, blocks, goal, radii, arena)
        there = vary & free & ~moved[target] & jax.random.bernoulli(key_use, on_the_way)
        blocks = jnp.where(there, blocks.at[target].set(pose), blocks)
        moved = moved.at[target].set(moved[target] | there)
    pose, unplaced = layouts.place_robot(key_robot, robot, blocks, radii, None, arena=arena)
    if facing:
        key_use, key_left, key_pose = jax.random.split(jax.random.fold_in(key_robot, 1), 3)
        left = jax.random.randint(key_left, (), 0, targets, jnp.int32)
        left = jnp.where(some & (left == which), (left + 1) % targets, left)
        stand, none = layouts.place_robot(
            key_pose, robot, blocks, radii, None, arena=arena, facing=blocks[left, :2]
        )
        use = ~none & jax.random.bernoulli(key_use, facing)
        pose, unplaced = jnp.where(use, stand, pose), unplaced & ~use
    robot, unplaced = jnp.where(vary, pose, at.robot), at.unplaced | (vary & unplaced)
    return at._replace(robot=robot, blocks=blocks, unplaced=unplaced), vary, moved


def _on_its_way(key, block, blocks, goal, radii, arena):
    """A pose between a block's own and the region's middle, and whether it is free."""
    key_share, key_aside, key_angle = jax.random.split(key, 3)
    share = jax.random.uniform(key_share, (_CANDIDATES, 1))
    aside = _ASIDE * jax.random.normal(key_aside, (_CANDIDATES, 2))
    places = goal[:2] + share * (blocks[block, :2] - goal[:2]) + aside
    limit = arena - radii[block]
    away = jnp.sum((places[:, None] - blocks[:, :2]) ** 2, axis=-1)
    clear = (away > (radii[block] + radii) ** 2) | (jnp.arange(len(radii)) == block)
    free = clear.all(axis=1) & (jnp.abs(places) <= limit).all(axis=1)
    angle = jax.random.uniform(key_angle, (1,), minval=-jnp.pi, maxval=jnp.pi)
    return jnp.concatenate([places[jnp.argmax(free)], angle]), free.any()
