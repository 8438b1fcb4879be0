"""A chain of goals: rewards progress towards the current subtask's goal, then the next one's.

    latents = reward.demo_latents(encoder_params, demos, config)
    chain = subtask_chain.from_latents(latents, shared.frames, demos.length, kept=shared.kept)
    progress = subtask_chain.init()
    progress, r = subtask_chain.step(chain, progress, encoder.apply(encoder_params, graph, config))

The goals are the mean latents of the demonstrations at the ends of their stages, as found by
`gril_jax.subtasks` and `gril_jax.subtasks.matching`. What is published pays minus the distance to
the present goal, one stage and one policy at a time. Strung together, such rewards fall back to
-1 whenever a stage is finished, so that a policy earns more by staying just short of it. Here the
reward of a whole chain is made one staircase from about -1 to 0:

    "continuous"  stage i leads from the reward at which it was entered up to (i + 1) / M - 1,
                  along the share of its distance that has been covered; nothing ever jumps.
    "stepped"     minus the distance to the goal, a stage's start being 1 / M away, and minus
                  `bonus` for each subtask still to come: a step up when one is finished.

A chain of one goal is the plain reward of `gril_jax.reward`. The reward depends on the progress,
so a policy should see `progress.index` beside its observation. Shapes use B for demonstrations, T
for frames, D for the latent, M for the goals and K for the members of an ensemble. The functions
take one episode; batch with `jax.vmap`.
"""

from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from gril_jax.encoders.ensemble import split, worst_distance
from gril_jax.errors import ConfigError, ShapeError
from gril_jax.graphs.activity import check_not_negative
from gril_jax.graphs.scene import safe_norm


class ChainParams(NamedTuple):
    """Goals in order. A distance is in units of its own stage: 1 at the stage's start."""

    goals: Float[Array, "M D"]
    # One over the latent distance of each stage's start from its goal, for each ensemble's member.
    scale: Float[Array, "M"] | Float[Array, "M K"]
    radius: Float[Array, "M"]  # distance at which a goal counts as reached
    count: Int[Array, ""]  # how many goals there are; the rest is padding


Mode = Literal["continuous", "stepped"]


class ChainProgress(NamedTuple):
    """State of an episode's chain, to be reset when the episode ends."""

    index: Int[Array, ""]  # subtasks finished; `count` when all are
    level: Float[Array, ""]  # the reward at which the present stage was entered
    entry: Float[Array, ""]  # the distance to its goal at that moment


def init() -> ChainProgress:
    """Progress before an episode's first frame, at a level of -1 and a distance of 1."""
    zero = jnp.zeros((), jnp.int32)
    return ChainProgress(zero, jnp.full((), -1.0), jnp.ones(()))


def step(
    params: ChainParams,
    progress: ChainProgress,
    latent: Float[Array, "D"],
    *,
    mode: Mode = "continuous",
    bonus: Float[Array, ""] | float | None = None,
    fallback: Float[Array, ""] | float | None = None,
) -> tuple[ChainProgress, Float[Array, ""]]:
    """The progress after the next frame, and that frame's reward.

    At most one subtask is finished in a frame. After the last one the reward stays what it is:
    minus the distance to the last goal, so that undoing the task costs again.

    Args:
      params: from `from_latents`.
      progress: from `init` before the first frame, then from the previous `step`.
      latent: of this frame.
      mode: how stages follow each other, see above.
      bonus: what finishing a subtask adds in the stepped mode, at least 0; 1 / M if left out.
        With less, the reward falls when a subtask is finished; 0 is what is published.
      fallback: the chain goes back by one subtask when the latent is further from the present
        goal than where the stage was entered, by more than this (in stage lengths), and outside
        the radius of the goal before. None: it never goes back within an episode.

    Returns:
      The progress and the reward, at most 0; below -1 where things are worse than at the start.

    Raises:
      ShapeError: the goals are not of the latent's size.
      ConfigError: the mode is another word, or a bonus or fallback is known and negative.
    """
    _check(params, latent, mode, bonus, fallback)
    last = jnp.maximum(params.count, 1) - 1
    share = 1.0 / (last + 1).astype(latent.dtype)
    stage = jnp.minimum(progress.index, last)
    distance = jax.vmap(worst_distance)(latent - params.goals, params.scale)

    # Towards the goal in shares of what there was to cover, away from it in stage lengths: a stage
    # that is entered close to its goal must not make a step back from there cost a fortune.
    here, entry = distance[stage], progress.entry
    covered = jnp.where(here < entry, 1.0 - here / jnp.where(entry > 0, entry, 1.0), entry - here)
    top = (stage + 1).astype(share.dtype) * share - 1.0
    value = progress.level + (top - progress.level) * covered

    index, towards = _next_stage(params, progress, distance, stage, last, fallback)
    changed = towards != stage
    progress = ChainProgress(
        index,
        jnp.where(changed, value, progress.level),
        # A stage that begins at its goal has no length, so its radius stands in.
        jnp.where(changed, jnp.maximum(distance[towards], params.radius[towards]), entry),
    )
    if mode == "stepped":
        bonus = share if bonus is None else bonus
        value = -share * distance[towards] - bonus * (last - towards).astype(share.dtype)
    return progress, value


def trajectory(
    params: ChainParams,
    latents: Float[Array, "T D"],
    *,
    mode: Mode = "continuous",
    bonus: Float[Array, ""] | float | None = None,
    fallback: Float[Array, ""] | float | None = None,
) -> tuple[Float[Array, "T"], Int[Array, "T"]]:
    """The reward and the number of finished subtasks after every frame of one recording.

    It is `step` from `init` on; arguments and errors are the same.

    >>> goals, ones = jnp.array([[1.0], [2.0]]), jnp.ones(2)
    >>> chain = ChainParams(goals, scale=ones, radius=0.1 * ones, count=jnp.int32(2))
    >>> rewards, index = trajectory(chain, jnp.array([[0.0], [0.5], [1.0], [1.5], [2.0]]))
    >>> rewards.tolist(), index.tolist()
    ([-1.0, -0.75, -0.5, -0.25, 0.0], [0, 0, 1, 1, 2])
    """

    def one(progress, latent):
        progress, value = step(params, progress, latent, mode=mode, bonus=bonus, fallback=fallback)
        return progress, (value, progress.index)

    return jax.lax.scan(one, init(), latents)[1]


def from_latents(
    latents: Float[Array, "B T D"],
    boundaries: Int[Array, "B M"],
    length: Int[Array, "B"] | None = None,
    *,
    kept: Bool[Array, "M"] | None = None,
    radius: Float[Array, ""] | float | None = None,
    members: int = 1,
) -> ChainParams:
    """A chain from demonstrations and the frames at which their stages end.

    Args:
      latents: of every frame of every demonstration.
      boundaries: last frame of each stage, increasing, -1 where a demonstration lacks it; from
        `subtask_matching.shared_boundaries`, or `boundary_frames` of each.
      length: frames before padding; all if left out.
      kept: which boundaries are goals (`SharedBoundaries.kept`). If left out: those that some
        demonstration has. If there are none, the last frames are the only goal.
      radius: distance at which a goal counts as reached, in stage lengths. If left out: how near
        90 % of the demonstrations end their stage to it, at least 0.05 and at most 0.5.
      members: of the ensemble that made the latents; its distance is that of its worst member.

    Returns:
      Parameters. A goal is the mean over the demonstrations that have the boundary; its scale is
      XIRL's, from the frames at which the boundary before was reached.

    Raises:
      ShapeError: the arrays are of different demonstrations, or there are no demonstrations.
      ConfigError: the radius is known and not positive.
    """
    _check_demos(latents, boundaries, length)
    if radius is not None and not isinstance(radius, jax.core.Tracer) and not float(radius) > 0:
        raise ConfigError(f"radius is {radius}; it must be positive.")
    (num_demos, num_frames, _), demos = latents.shape, jnp.arange(latents.shape[0])[:, None]
    length = jnp.full(num_demos, num_frames) if length is None else length
    kept = jnp.any(boundaries >= 0, axis=0) if kept is None else kept
    boundaries = jnp.pad(boundaries, ((0, 0), (0, not boundaries.shape[1])), constant_values=-1)
    kept = jnp.pad(kept, (0, boundaries.shape[1] - kept.shape[0]))
    order = jnp.argsort(~kept, stable=True)
    boundaries, kept = boundaries[:, order], kept[order]

    has = (boundaries >= 0) & (boundaries < length[:, None]) & kept
    # A slot without a boundary gets the last frames: padding, or the only goal.
    ends = jnp.where(has, boundaries, length[:, None] - 1)
    before = jnp.pad(has, ((0, 0), (1, 0)), constant_values=True)[:, :-1]
    starts = jnp.pad(jnp.where(has, boundaries, 0), ((0, 0), (1, 0)))[:, :-1]
    weights = jnp.where(jnp.any(has, axis=0), has, True)
    at_ends, at_starts = latents[demos, ends], latents[demos, starts]
    goals = _mean(at_ends, weights[..., None])
    gap = _mean(safe_norm(split(at_starts - goals, members)), (weights & before)[..., None])
    scale = 1.0 / jnp.where(gap > 0, gap, 1.0)
    scale = scale if members > 1 else scale[:, 0]
    if radius is None:
        distance = jax.vmap(jax.vmap(worst_distance), (0, None))(at_ends - goals, scale)
        spread = jnp.where(weights, distance, jnp.nan)
        radius = jnp.clip(jnp.nanquantile(spread, 0.9, axis=0), 0.05, 0.5)
    radius = jnp.broadcast_to(radius, scale.shape[:1])
    return ChainParams(goals, scale, radius, jnp.maximum(jnp.sum(kept), 1))


def _next_stage(params, progress, distance, stage, last, fallback):
    """Subtasks finished after this frame, and the stage of the next one."""
    here = distance[stage]
    reached = (progress.index == stage) & (here <= params.radius[stage])
    index = progress.index + reached.astype(progress.index.dtype)
    towards = jnp.where(reached, jnp.minimum(stage + 1, last), stage)
    if fallback is None:
        return index, towards
    previous = jnp.maximum(stage - 1, 0)
    lost = (here - progress.entry > fallback) & (distance[previous] > params.radius[previous])
    lost = lost & (stage > 0)
    return jnp.where(lost, previous, index), jnp.where(lost, previous, towards)


def _mean(values, weights):
    total = jnp.sum(jnp.where(weights, values, 0.0), axis=0)
    return total / jnp.maximum(jnp.sum(weights, axis=0), 1)


def _check(params, latent, mode, bonus, fallback):
    if mode not in ("continuous", "stepped"):
        raise ConfigError(f"mode is {mode!r}; it must be 'continuous' or 'stepped'.")
    check_not_negative(bonus=bonus, fallback=fallback)
    if params.goals.ndim != 2 or not len(params.goals) or params.goals.shape[1:] != latent.shape:
        raise ShapeError(
            f"params.goals has shape {params.goals.shape} but latent has shape {latent.shape}; "
            f"they must be (goals, D) and (D,)."
        )


def _check_demos(latents, boundaries, length):
    shape = latents.shape
    fits = len(shape) == 3 and 0 not in shape and boundaries.shape[:-1] == shape[:1]
    if not fits or (length is not None and length.shape != shape[:1]):
        other = "" if length is None else f" and length has shape {length.shape}"
        raise ShapeError(
            f"latents has shape {shape}, boundaries has shape {boundaries.shape}{other}; they must "
            f"be (demonstrations, frames, D), (demonstrations, goals) and (demonstrations,)."
        )
