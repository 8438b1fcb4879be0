"""Observations of MatchRegions: four vectors to choose from, each with a name for each number.

"plain" holds poses and velocities of robot and blocks and the region's place, in the robot's frame
where that helps. "rich" also says which blocks are in the region. "sorted" lists the targets that
are outside the region first, and among those the nearest to the robot first.
"xmagical" is x-magical's state vector in its exact order. Lengths are in arena units.
"""

from typing import NamedTuple

import jax.numpy as jnp
from gril_jax.envs.magical.layout import turned
from gril_jax.envs.magical.suite import state
from gril_jax.envs.planar.robots import FINGER_OPEN
from jaxtyping import Array, Bool, Float

from .score import DIAGONAL

OBSERVATIONS = ("plain", "rich", "sorted", "xmagical")

_FAR = 100.0  # more than any squared distance in an arena


class Observed(NamedTuple):
    """One scene; P parts of the robot (3 with fingers, else 1), B blocks, targets first."""

    pose: Float[Array, "E 3"]  # parts, then blocks
    velocity: Float[Array, "E 3"]
    goal: Float[Array, "4"]  # centre x, y; width, height
    inside: Bool[Array, "B"]


def _own_frame(scene: Observed, parts: int, *, tested: bool, due: int) -> Float[Array, "O"]:
    """The observation, with the `tested` region or without.

    The first `due` targets are sorted: outside the region first, then by distance (0: none)."""
    x_y, yaw = scene.pose[0, :2], scene.pose[0, 2]
    robot = state.robot_features(scene.pose, scene.velocity, parts)
    robot += [turned(-yaw, scene.goal[:2] - x_y), scene.goal]
    blocks, speed = scene.pose[parts:], scene.velocity[parts:]
    local = turned(-yaw, blocks[:, :2] - x_y)
    turns = jnp.stack([jnp.cos(blocks[:, 2]), jnp.sin(blocks[:, 2]), speed[:, 2] / 10.0], axis=1)
    each = [local, blocks[:, :2], blocks[:, :2] - scene.goal[:2], speed[:, :2], turns]
    if tested:
        each.append(scene.inside.astype(jnp.float32)[:, None])
    each = jnp.concatenate(each, axis=1)
    if not due:
        return jnp.concatenate([*robot, each.reshape(-1)])
    # Row k of the permutation marks the k-th target in that order.
    last = jnp.sum(local[:due] ** 2, axis=-1) + _FAR * scene.inside[:due]
    order = jnp.argsort(last)[:, None] == jnp.arange(due)
    first = jnp.sum(jnp.where(order[:, :, None], each[:due], 0.0), axis=1)  # exact, and no gather
    each = jnp.concatenate([first, each[due:]])
    return jnp.concatenate([*robot, each.reshape(-1), order.astype(jnp.float32).reshape(-1)])


def _xmagical(scene: Observed, parts: int, targets: int) -> Float[Array, "O"]:
    robot, blocks = scene.pose[0], scene.pose[parts:, :2]
    length = lambda d: jnp.sqrt(jnp.sum(d**2, axis=-1) + 1e-12) / DIAGONAL  # noqa: E731
    reach, goal = length(blocks - robot[:2]), length(blocks - scene.goal[:2])
    each = [robot[:2], blocks.reshape(-1), jnp.stack([jnp.cos(robot[2]), jnp.sin(robot[2])])]
    each += [reach[:targets], goal[:targets], reach[targets:], goal[targets:]]
    if parts > 1:  # an angle of 45 degrees between the fingers is fully open
        spread = (scene.pose[1:2, 2] - scene.pose[2:3, 2]) / (2 * FINGER_OPEN)
        each.append(jnp.clip(spread, 0.0, 1.0))
    return jnp.concatenate(each)


def observe(kind: str, scene: Observed, *, parts: int, targets: int) -> Float[Array, "O"]:
    """The observation of the given kind, one of `OBSERVATIONS`."""
    if kind == "xmagical":
        return _xmagical(scene, parts, targets)
    due = targets if kind == "sorted" else 0
    return _own_frame(scene, parts, tested=kind != "plain", due=due)


def names(kind: str, blocks: tuple[str, ...], *, fingers: bool, targets: int) -> tuple[str, ...]:
    """One name for each number of the observation; equal names in a row are one quantity."""
    if kind != "xmagical":
        robot = state.robot_names(fingers)
        robot |= {
            "region centre in the robot's frame": 2, "region centre": 2, "region size": 2,
        }  # fmt: skip
        block = {
            "centre in the robot's frame": 2, "centre": 2, "offset to the region": 2,
            "velocity": 2, "angle, cosine and sine": 2, "turn rate / 10": 1,
            "inside the region": int(kind != "plain"),
        }  # fmt: skip
        rows, order = blocks, []
        if kind == "sorted":
            due = [f"target {k + 1} in turn" for k in range(targets)]
            rows = (*due, *blocks[targets:])
            order = [(f"{row} is {b}", 1) for row in due for b in blocks[:targets]]
        each = ((f"{b}: {p}", n) for b in rows for p, n in block.items())
        parts = [*robot.items(), *each, *order]
    else:
        numbered = [f"block {k + 1} ({b})" for k, b in enumerate(blocks)]
        parts = [("robot position", 2), *((f"{b} centre", 2) for b in numbered)]
        parts.append(("robot heading, cosine and sine", 2))
        for group in (numbered[:targets], numbered[targets:]):
            parts += [(f"{b} distance to robot / diagonal", 1) for b in group]
            parts += [(f"{b} distance to region / diagonal", 1) for b in group]
        parts.append(("finger opening", int(fingers)))
    return tuple(name for name, count in parts for _ in range(count))
