"""Starts of MatchRegions: those that a variant draws, and varied ones for training."""

import jax
import jax.numpy as jnp
from gril_jax.envs.magical import layout as layouts
from gril_jax.envs.planar.robots import Robot
from jaxtyping import Array, Bool, Float, Key, PRNGKeyArray

# MAGICAL's Demo layout: x, y (arena units) and angle (rad).
DEMO_ROBOT = (-0.5, 0.1, -1.2 * 3.141592653589793)
DEMO_BLOCKS = {
    "green star": (0.80, -0.70, 2.37),
    "green square": (-0.68, 0.72, 1.28),
    "blue pentagon": (-0.05, -0.20, -1.09),
    "yellow circle": (-0.75, -0.55, 2.78),
    "yellow pentagon": (0.30, -0.82, -1.15),
}
DEMO_GOAL = (0.40, 0.35, 0.60, 0.70)  # centre x, y; width, height

_CANDIDATES = 16
_ASIDE = 0.15  # arena units, standard deviation of a block's place from the straight way


def places(
    key: PRNGKeyArray,
    variant: str,
    blocks: tuple[str, ...],
    *,
    robot: Robot,
    radii: Float[Array, "B"],
    arena: float,
) -> layouts.Layout:
    """The places of a start: the Demo layout's, near them, or anywhere."""
    if variant in ("layout", "all"):
        return layouts.scatter(key, robot, radii, arena=arena)
    demo = jnp.array(DEMO_ROBOT), jnp.array([DEMO_BLOCKS[b] for b in blocks]), jnp.array(DEMO_GOAL)
    layout = layouts.Layout(*demo, jnp.zeros((), bool))
    return layouts.jitter(key, layout, arena=arena) if variant == "jitter" else layout


def varied(
    keys: Key[Array, "2"],
    layout: layouts.Layout,
    *,
    share: float,
    on_the_way: float,
    facing: float,
    targets: int,
    robot: Robot,
    radii: Float[Array, "B"],
    arena: float,
) -> tuple[layouts.Layout, Bool[Array, ""], Bool[Array, "B"]]:
    """A start that in a `share` of the episodes has the robot anywhere and targets further on.

    Two times in three one target is in the region, unless it is the only one and may be on its way;
    of the other targets each is somewhere on its way there with probability `on_the_way`, so that
    what is left to do is short now and then; and
    with probability `facing` the robot is not anywhere but before a target that is not in it.
    The first `targets` blocks are the targets. Returns also whether the start was varied, and the
    blocks that were.
    """
    never = jnp.zeros(len(radii), bool)
    if not share:
        return layout, jnp.zeros((), bool), never
    vary = jax.random.uniform(keys[0]) < share
    key_robot, key_some, key_which, key_where = jax.random.split(keys[1], 4)
    which = jax.random.randint(key_which, (), 0, targets, jnp.int32)
    several = targets > 1 or not on_the_way  # a single one in it leaves nothing to learn
    some = vary & (jax.random.uniform(key_some) < 2 / 3) & several
    unit = jax.random.uniform(key_where, (3,), minval=-1.0)
    goal = layout.goal
    inside = jnp.concatenate([goal[:2] + 0.35 * goal[2:] * unit[:2], jnp.pi * unit[2:]])
    blocks = jnp.where(some, layout.blocks.at[which].set(inside), layout.blocks)
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
    robot, unplaced = jnp.where(vary, pose, layout.robot), layout.unplaced | (vary & unplaced)
    return layout._replace(robot=robot, blocks=blocks, unplaced=unplaced), vary, moved


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
