"""A start from boxes of a demonstration, as its task's variant might have drawn it.

A demonstration shows the colours, shapes and places of Demo. In a variant that draws other ones a
moment of it is worth as much with every colour another, every shape another, or the whole scene
turned, mirrored and moved: two blocks that were alike still are, and what lay in a region still
does.
"""

import jax
import jax.numpy as jnp
from gril_jax.envs.magical import layout as layouts
from gril_jax.envs.planar.robots import Robot
from gril_jax.envs.planar.shapes import NOTHING, SHAPES
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from .plan import Kinds, outside
from .state import Order


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

    Boxes do not show angles, which are drawn; a robot that could not stand there at those drawn, as
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
