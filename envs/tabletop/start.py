"""Starts on the table: a group of things moved as one, and each of them a little.

As in RLBench, a task's things are one group, put down with a random offset and yaw. Each then gets
a jitter of its own. Of a fixed number of arrangements the first without overlap is taken.

An episode may also begin at a state of a recorded one, so that training meets each stage from the
first update on (Nair et al. 2018, Salimans and Chen 2018). The recorded actions are not imitated.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.panda.kinematics import quaternion_about_z
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

GROUP_SHIFT, GROUP_YAW = 0.04, 0.3927  # metres, rad (22.5 degrees): at most, either way
SHIFT, YAW = 0.02, 0.3  # of each thing within the group
_MIDDLE = (0.5, 0.0)  # about which the group turns, metres
_GAP = 0.01  # metres, between things
_CANDIDATES = 32


class Start(NamedTuple):
    """Start of a task's own objects."""

    joints: Float[Array, "J"]  # positions of the joints after the arm's
    fixtures: Float[Array, "M 7"]  # position and quaternion of what stands still
    unplaced: Bool[Array, ""]  # no arrangement was free of overlap; this is the first one sampled


class Footprint(NamedTuple):
    """The places of N things on the table."""

    place: Float[Array, "*N 3"]  # x, y (metres), yaw (rad)
    half: Float[Array, "*N 2"]  # half extents along their own axes, metres


NOTHING = Footprint(np.zeros((0, 3), np.float32), np.zeros((0, 2), np.float32))


def reach(yaws: Float[Array, "*K"], thing: Footprint) -> Float[Array, "*K"]:
    """Half of a thing's extent along directions."""
    turn = yaws - thing.place[2]
    return thing.half[0] * jnp.abs(jnp.cos(turn)) + thing.half[1] * jnp.abs(jnp.sin(turn))


def apart(a: Footprint, b: Footprint) -> Bool[Array, ""]:
    """True if a gap of 1 cm or more is between two things (the separating axis theorem)."""
    yaws = jnp.stack([a.place[2], a.place[2] + jnp.pi / 2, b.place[2], b.place[2] + jnp.pi / 2])
    axes = jnp.stack([jnp.cos(yaws), jnp.sin(yaws)], axis=1)  # (4, 2)
    distance = jnp.abs(jnp.sum(axes * (a.place[:2] - b.place[:2]), axis=1))
    return (distance - reach(yaws, a) - reach(yaws, b) >= _GAP).any()


def group(key: PRNGKeyArray, places: Float[Array, "N 3"], *, share: float) -> Float[Array, "N 3"]:
    """Places (x, y, yaw) of the task's layout after one random offset and yaw of all.

    `share` is that of the ranges; 0 leaves everything where it is.
    """
    drawn = share * jax.random.uniform(key, (3,), minval=-1.0)
    shift, turn = GROUP_SHIFT * drawn[:2], GROUP_YAW * drawn[2]
    c, s = jnp.cos(turn), jnp.sin(turn)
    away = places[:, :2] - jnp.array(_MIDDLE)
    moved = jnp.stack([c * away[:, 0] - s * away[:, 1], s * away[:, 0] + c * away[:, 1]], axis=1)
    moved += jnp.array(_MIDDLE) + shift
    return jnp.concatenate([moved, places[:, 2:] + turn], axis=1)


def place(
    key: PRNGKeyArray, things: Footprint, standing: Footprint, *, share: float
) -> tuple[Float[Array, "N 3"], Bool[Array, ""]]:
    """Jitters things by a share of the ranges, clear of each other and of what is standing.

    Returns their places, and whether no arrangement was found (then that of the first draw).
    """
    count = len(things.place)
    unit = jax.random.uniform(key, (_CANDIDATES, count, 3), minval=-1.0)
    candidates = things.place + share * unit * jnp.array([SHIFT, SHIFT, YAW])

    def fits(places: Float[Array, "N 3"]) -> Bool[Array, ""]:
        moved = things._replace(place=places)
        every = Footprint(*(jnp.concatenate(p) for p in zip(moved, standing, strict=True)))
        gaps = jax.vmap(jax.vmap(apart, in_axes=(None, 0)), in_axes=(0, None))(moved, every)
        own = jnp.arange(count)[:, None] == jnp.arange(len(every.place))
        return (gaps | own).all()

    fit = jax.vmap(fits)(candidates)
    return candidates[jnp.argmax(fit)], ~fit.any()


def free_joint(places: Float[Array, "N 3"], height: Float[Array, ""] | float):
    """Positions (7 N,) of free joints of objects that stand level with centres at `height`."""
    heights = jnp.full((len(places), 1), height)
    rows = (places[:, :2], heights, quaternion_about_z(places[:, 2]))
    return jnp.concatenate(rows, axis=1).reshape(-1)


class Moments(NamedTuple):
    """P snapshots of any episodes; or one of them, without the axis P."""

    qpos: Float[Array, "*P Q"]
    qvel: Float[Array, "*P V"]
    target: Float[Array, "*P 8"]  # the servos' aims: joints, opening of a finger
    fixtures: Float[Array, "*P M 7"]
    reached: Bool[Array, "*P K"]  # stages that have held by then
    best: Int[Array, "*P"]  # most stages that have been done at once by then
    moved: Bool[Array, "*P N"]  # objects that have moved by then


def draw_moment(key: PRNGKeyArray, moments: Moments) -> Moments:
    """Samples one of them uniformly. The key is consumed."""
    at = jax.random.randint(key, (), 0, len(moments.best))
    return jax.tree.map(lambda x: jnp.asarray(x)[at], moments)
