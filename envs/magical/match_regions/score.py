"""Scores and dense rewards of MatchRegions, and what an episode remembers for them.

Rewards have the names of the table in which x-magical's history was collected: "S4" is the dense
reward at the tip of its branches, "V5" the long-lived one before. The stages are each target in the
region; their faults: each distractor in it. Distances are in arena units.
"""

from typing import NamedTuple

import jax.numpy as jnp
from gril_jax.envs.base import Objects
from gril_jax.envs.magical.suite import state
from gril_jax.envs.magical.suite.plan import Scene, in_region, in_region_stage
from gril_jax.envs.magical.suite.state import SuiteData
from gril_jax.envs.planar import shapes
from gril_jax.envs.planar.robots import Robot
from gril_jax.envs.stages import Stages
from jaxtyping import Array, Bool, Float

from . import SPEC

REWARDS = SPEC.rewards
REGION, ROBOT, _FIRST = 0, 1, 2
DIAGONAL = 2.8284271247461903  # by which V5 divides distances: of a +-1 arena


class ScoreInputs(NamedTuple):
    """Scoring inputs at one step; K targets, targets first among the B blocks."""

    inside: Bool[Array, "B"]  # block's centre in the region
    distance: Float[Array, "K"]  # of each target to the region's centre
    start: Float[Array, "K"]  # the same at reset
    nearest: Float[Array, "K"]  # the least of each target to the robot since reset


def _counts(at: ScoreInputs) -> tuple[Array, Array]:
    targets = len(at.distance)
    inside = at.inside.astype(jnp.float32)
    return inside[:targets].sum(), inside[targets:].sum()


def score(at: ScoreInputs) -> Float[Array, ""]:
    """(n_t / K) (1 - n_d / (n_t + n_d)) with n_t targets and n_d distractors in the region."""
    n_t, n_d = _counts(at)
    return n_t / len(at.distance) * (1.0 - n_d / jnp.maximum(n_t + n_d, 1.0))


def _s4(at: ScoreInputs) -> Float[Array, ""]:
    _, n_d = _counts(at)
    left = jnp.where(at.inside[: len(at.distance)], 0.0, at.distance)
    return 10.0 * jnp.tanh((jnp.sum(at.start - left) - n_d - 0.1) / 2)


def _v5(at: ScoreInputs) -> Float[Array, ""]:
    n_t, n_d = _counts(at)
    share = 1.0 / jnp.maximum(n_t + n_d, 1.0)
    far = -10.0 * jnp.mean(at.distance) / DIAGONAL * (1.0 + jnp.sqrt(n_d * share))
    near = jnp.maximum(1.0 - at.nearest / DIAGONAL, 0.0)
    near = jnp.sum(jnp.where(at.inside[: len(at.distance)], 0.0, near))
    return far + 4.0 + near + 10.0 * n_t * share + 10.0 * n_t - 5.0 * n_d


def reward(name: str, at: ScoreInputs) -> Float[Array, ""]:
    """The dense reward of the given name, one of `REWARDS`; "sparse" is the score."""
    return {"S4": _s4, "V5": _v5, "sparse": score}[name](at)


def stages(blocks: tuple[str, ...], targets: int, *, arena: float) -> Stages:
    """The stages of the task with these blocks, targets first, in an arena |x|, |y| <= `arena`."""
    movable = tuple(range(_FIRST, _FIRST + len(blocks)))
    names = enumerate(blocks, _FIRST)
    made = [in_region_stage(i, REGION, f"{name} in the region", movable) for i, name in names]
    done, wrong = tuple(made[:targets]), tuple(made[targets:])
    return Stages(
        done, faults=wrong, movable=movable, robots=(ROBOT,), half_extent=arena, score=_score
    )


def _score(task: Stages, center: Float[Array, "N 2"], size: Float[Array, "N 2"]):
    inside = jnp.concatenate([task.done(center, size), task.faulty(center, size)])
    unused = jnp.zeros(len(task.stages))
    return score(ScoreInputs(inside, unused, unused, unused))


class Progress(NamedTuple):
    """The memory of an episode beside the simulator's; K targets, B blocks."""

    start_distance: Float[Array, "K"]  # of each target to the region's centre at reset
    nearest: Float[Array, "K"]  # of each target to the robot since reset
    varied: Float[Array, ""]  # 1 in an episode that began with a varied start
    moved: Bool[Array, "B"]  # the blocks that such a start put elsewhere


def distances(points: Float[Array, "K C"], center: Float[Array, "2"]) -> Float[Array, "K"]:
    """Distances of points (x, y, ...) from a centre, arena units."""
    return jnp.sqrt(jnp.sum((points[:, :2] - center) ** 2, axis=1) + 1e-12)


def inputs(scene: Scene, targets: int) -> ScoreInputs:
    """The quantities of scores and rewards; the first blocks are the `targets`."""
    return ScoreInputs(
        inside=in_region(scene.regions[0], scene.blocks),
        distance=distances(scene.blocks[:targets], scene.regions[0, :2]),
        start=scene.progress.start_distance,
        nearest=scene.progress.nearest,
    )


def objects(data: SuiteData, robot: Robot) -> Objects:
    """Region, robot and blocks as a detector would report them."""
    base, blocks, region = data.pose[0], data.pose[len(robot.parts) :], data.regions[0]
    kinds = 2 + len(shapes.SHAPES) * data.colour + data.shape
    sizes = state.robot_size(robot, base[2]), state.block_sizes(data.shape, blocks[:, 2])
    return Objects(
        center=jnp.concatenate([region[None, :2], base[None, :2], blocks[:, :2]]),
        size=jnp.concatenate([region[None, 2:], sizes[0][None], sizes[1]]),
        label=jnp.concatenate([jnp.arange(2), kinds]).astype(jnp.int32),
        is_robot=jnp.arange(2 + len(blocks)) == 1,
    )
