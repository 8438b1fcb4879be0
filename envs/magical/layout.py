"""MAGICAL's variants as x-magical has them: what `reset` samples, inside jit.

Entities are placed one after another (region, robot, blocks), each at the first of `_CANDIDATES`
uniform poses that touches nothing placed before. If none is free the first is taken and the episode
says so (`unplaced`). Blocks count as their bounding circles, a little stricter than MAGICAL's test.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.magical.simulator import PRESETS, Preset
from gril_jax.envs.planar.joints import Strengths
from gril_jax.envs.planar.robots import FINGER_OPEN, PIVOTS, Robot
from gril_jax.envs.planar.shapes import SHAPES
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

VARIANTS = ("demo", "jitter", "layout", "color", "shape", "dynamics", "all")
COLOURS = ("green", "blue", "yellow", "red")
# What a detector of their pictures tells apart.
CLASSES = ("goal", "robot", *(f"{c} {s}" for c in COLOURS for s in SHAPES))
RADII = np.array([0.156, 0.1525, 0.138, 0.12], np.float32)  # of star, square, pentagon, circle
_CANDIDATES, _AT_ONCE = 64, 8
_BESIDE = 0.6  # furthest from the place at which a robot is to stand
_FACING = (0.55, 0.75, 0.4)  # distances from which a robot faces a point, and rad off it
_DYNAMICS = Strengths((3.2, 5.5), (0.7, 1.5), (2.5, 4.5), (1.0, 1.8), (0.07, 0.15))


class Places(NamedTuple):
    """The places of everything at the start of an episode."""

    robot: Float[Array, "3"]
    blocks: Float[Array, "B 3"]
    regions: Float[Array, "R 4"]  # centre x, y; width, height
    unplaced: Bool[Array, ""]  # something found no free place


def jitter(key: PRNGKeyArray, start: Places, *, arena: float) -> Places:
    """MAGICAL's Jitter variant: every number changes a little, and no overlap can arise."""
    keys = jax.random.split(key, 3)
    spread = jnp.array([0.025 * arena, 0.025 * arena, 0.157])
    size = jnp.array([0.025 * arena, 0.025 * arena, 0.0075, 0.0075])
    near = lambda k, x, most: x + most * jax.random.uniform(k, x.shape, minval=-1.0)  # noqa: E731
    robot, blocks = near(keys[0], start.robot, spread), near(keys[1], start.blocks, spread)
    region = near(keys[2], start.regions[0], size)
    return start._replace(robot=robot, blocks=blocks, regions=region[None])


def radii(shape: Int[Array, "*B"]) -> Float[Array, "*B"]:
    """Radii of blocks' bounding circles; 0 for a slot without a block."""
    return jnp.append(jnp.asarray(RADII), 0.0)[shape]


def gap_to_region(xy: Float[Array, "*C 2"], region: Float[Array, "4"]) -> Float[Array, "*C"]:
    """Distances of points from a region; 0 within it."""
    outside = jnp.maximum(jnp.abs(xy - region[:2]) - region[2:] / 2, 0.0)
    return jnp.sqrt(jnp.sum(outside**2, axis=-1))


def turned(angle: Float[Array, "..."], xy: Float[Array, "... 2"]) -> Float[Array, "... 2"]:
    """Points turned counter-clockwise about the origin by an angle in rad."""
    c, s = jnp.cos(angle), jnp.sin(angle)
    return jnp.stack([c * xy[..., 0] - s * xy[..., 1], s * xy[..., 0] + c * xy[..., 1]], axis=-1)


def rim(robot: Robot) -> np.ndarray:
    """Points (V, 2) around a robot with open fingers, in its frame, at most 0.03 apart."""
    outlines = [robot.parts[0].outline]
    for part, pivot, side in zip(robot.parts[1:], PIVOTS, (1, -1), strict=False):
        c, s = np.cos(side * np.pi / 8), np.sin(side * np.pi / 8)
        outlines.append(part.outline @ np.array([[c, s], [-s, c]]) + pivot)
    points = []
    for outline in outlines:
        for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True):
            count = int(np.ceil(np.linalg.norm(b - a) / 0.03))
            points.append(a + np.linspace(0, 1, count, endpoint=False)[:, None] * (b - a))
    return np.concatenate(points).astype(np.float32)


def _candidates(key: PRNGKeyArray, limit: float | Array) -> Float[Array, "C 3"]:
    unit = jax.random.uniform(key, (_CANDIDATES, 3), minval=-1.0)
    limit = jnp.asarray(limit, jnp.float32)
    return unit * jnp.stack([limit, limit, jnp.full_like(limit, jnp.pi)])


def first_free(
    poses: Float[Array, "C K"],
    free: Callable[[Float[Array, "_ K"]], Bool[Array, "_"]],
    *,
    wanted: Bool[Array, ""] | bool = True,
) -> tuple[Float[Array, "K"], Bool[Array, ""]]:
    """The first of the poses that is free, and True; if none is, or none is wanted, the first of
    all and False.

    Most starts need one or two, so poses are tried a few at a time.
    """

    def more(tried):
        at, _, found = tried
        return jnp.asarray(wanted) & ~found & (at < len(poses))

    def some(tried):
        at, kept, _ = tried
        few = jax.lax.dynamic_slice_in_dim(poses, at, _AT_ONCE)
        good = free(few)
        return at + _AT_ONCE, jnp.where(good.any(), few[jnp.argmax(good)], kept), good.any()

    begun = jnp.zeros((), jnp.int32), poses[0], jnp.zeros((), bool)
    return jax.lax.while_loop(more, some, begun)[1:]


def place_robot(
    key: PRNGKeyArray,
    robot: Robot,
    blocks: Float[Array, "B 3"],
    radii: Float[Array, "B"],
    goal: Float[Array, "4"] | None,
    *,
    arena: float,
    facing: Float[Array, "2"] | None = None,
    at: Float[Array, "2"] | None = None,
    wanted: Bool[Array, ""] | bool = True,
) -> tuple[Float[Array, "3"], Bool[Array, ""]]:
    """Samples a robot pose clear of walls, blocks and region (None: may stand in it), anywhere, a
    little before a point and about `facing` it, or `at` a place or beside it, as near as one of
    those sampled. Returns it, and True if there was none, or none was `wanted`."""
    poses = _candidates(key, arena - 0.05 if facing is None else 1.0)
    if at is not None:
        away = jnp.linspace(0.0, 1.0, len(poses))[:, None] ** 2 * _BESIDE
        way = poses[:, :2] / jnp.linalg.norm(poses[:, :2], axis=1, keepdims=True)
        poses = poses.at[:, :2].set(at + away * way)
    if facing is not None:  # around it, from candidates with x and y in [-1, 1]
        nearest, furthest, aside = _FACING
        angle = poses[:, 2]
        away = nearest + (furthest - nearest) * (poses[:, :1] + 1.0) / 2
        ahead = jnp.stack([-jnp.sin(angle), jnp.cos(angle)], axis=1)  # a robot's y axis
        turn = angle[:, None] + aside * poses[:, 1:2]
        poses = jnp.concatenate([facing - away * ahead, turn], axis=1)
    around = jnp.asarray(rim(robot))

    def free(poses):
        points = turned(poses[:, None, 2], around) + poses[:, None, :2]  # (C, V, 2)
        good = (jnp.abs(points) < arena).all(axis=(1, 2))
        if goal is not None:
            good &= (gap_to_region(points, goal) > 0).all(axis=1)
        if len(radii):
            apart = jnp.sum((points[:, :, None] - blocks[:, :2]) ** 2, axis=-1)
            good &= (apart > radii**2).all(axis=(1, 2))
        return good

    pose, found = first_free(poses, free, wanted=wanted)
    return pose, ~found


def stand(
    keys: tuple[PRNGKeyArray, PRNGKeyArray],
    robot: Robot,
    blocks: Float[Array, "B 3"],
    radii: Float[Array, "B"],
    *,
    arena: float,
    at: Float[Array, "2"],
) -> Float[Array, "3"]:
    """A robot's pose at a place or beside it, and anywhere if it is not free near there."""
    there, taken = place_robot(keys[0], robot, blocks, radii, None, arena=arena, at=at)
    elsewhere, _ = place_robot(keys[1], robot, blocks, radii, None, arena=arena, wanted=taken)
    return jnp.where(taken, elsewhere, there)


def scatter(key: PRNGKeyArray, robot: Robot, radii: Float[Array, "B"], *, arena: float) -> Places:
    """MAGICAL's Layout variant: region, robot and blocks, placed in this order without overlap."""
    key_goal, key_robot, *keys = jax.random.split(key, 2 + len(radii))
    unit = jax.random.uniform(key_goal, (4,))
    size = 0.5 + 0.3 * unit[2:]
    goal = jnp.concatenate([(2 * unit[:2] - 1) * (arena - size / 2), size])
    none = jnp.zeros((0, 3))
    pose, unplaced = place_robot(key_robot, robot, none, none[:, 0], goal, arena=arena)
    points = turned(pose[2], jnp.asarray(rim(robot))) + pose[:2]
    blocks = jnp.zeros((0, 3))
    for b, key_b in enumerate(keys):

        def clear(poses, b=b, placed=blocks):
            from_robot = jnp.sum((poses[:, None, :2] - points) ** 2, axis=-1).min(axis=1)
            apart = jnp.sum((poses[:, None, :2] - placed[:, :2]) ** 2, axis=-1)
            free = gap_to_region(poses[:, :2], goal) > radii[b]
            free &= (apart > (radii[b] + radii[:b]) ** 2).all(axis=1)
            return free & (from_robot > radii[b] ** 2)

        one, found = first_free(_candidates(key_b, arena - radii[b]), clear)
        blocks, unplaced = jnp.concatenate([blocks, one[None]]), unplaced | ~found
    return Places(pose, blocks, goal[None], unplaced)


def colours(key: PRNGKeyArray, colour: Int[Array, "B"], num_targets: int) -> Int[Array, "B"]:
    """MAGICAL's Color variant: any colour for the targets, the other three for the distractors.

    The distractors' colours keep their order: two of one colour stay alike.
    """
    target = jax.random.randint(key, (), 0, len(COLOURS))
    rank = colour - (colour > colour[0])  # among the colours that the targets do not have
    other = rank + (rank >= target)
    return jnp.where(jnp.arange(len(colour)) < num_targets, target, other).astype(jnp.int32)


def dynamics(key: PRNGKeyArray) -> Strengths:
    """MAGICAL's Dynamics variant: forces and torques, uniform in the original's ranges."""
    low, high = np.array(_DYNAMICS, np.float32).T
    drawn = jax.random.uniform(key, (len(low),), minval=low, maxval=high)
    return Strengths(*drawn)


def strengths(key: PRNGKeyArray, preset: Preset, *, vary: bool) -> Strengths:
    """The largest forces: the preset's, or sampled from its ranges."""
    if not vary:
        return Strengths(*(jnp.float32(s) for s in preset.strengths))
    drawn = dynamics(key)
    (low, high), (least, most) = PRESETS["xmagical"].drives, preset.drives
    if (least, most) == (low, high):
        return drawn
    return drawn._replace(drive=least + (drawn.drive - low) * (most - least) / (high - low))


def robot_pose(robot: Robot, base: Float[Array, "3"]) -> Float[Array, "P 3"]:
    """Poses of the robot's parts with open fingers, from the base's pose."""
    if not robot.has_fingers:
        return base[None]
    c, s = jnp.cos(base[2]), jnp.sin(base[2])
    pivots = jnp.asarray(PIVOTS, jnp.float32) @ jnp.array([[c, s], [-s, c]])
    angle = base[2] + FINGER_OPEN * jnp.array([1.0, -1.0])
    fingers = jnp.concatenate([base[:2] + pivots, angle[:, None]], axis=1)
    return jnp.concatenate([base[None], fingers])
