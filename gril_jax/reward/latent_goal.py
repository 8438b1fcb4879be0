"""The learned reward: minus the latent distance to the goal (Eq. 7 of the paper).

    params = reward.from_demos(encoder_params, demos, config)
    graph = graphs.scene_graph(center, size, label, is_robot, active)
    r = reward.latent_goal_reward(params, graph, config)

Goal and scale are XIRL's: the goal is the mean latent of the demonstrations' last frames, the
scale makes the reward about -1 at their first frames. Several last frames may be the goals, of
which the nearest counts. Every encoder of `gril_jax.encoders.encoder` will do; for the pixel
encoder take `from_latents` of its frames:

    first, last = (encoder.apply(encoder_params, x, config) for x in (first_frames, last_frames))
    params = reward.from_latents(encoder_params, first, last)

An ensemble's reward is that of its most pessimistic member (`gril_jax.encoders.ensemble`).

A method that predicts progress has a head (`gril_jax.losses.heads`). Its reward is the progress
less that of the goal, with the same scale.

Shapes use B for demonstrations, T for frames, N for objects and D for the latent (of all members
side by side). G is for the goals of a set and K for the members of an ensemble. The reward takes
one graph, or frames with any leading axes. Batch graphs, or the parameters of many seeds, with
`jax.vmap`.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from gril_jax.config.encoder import PoolConfig
from gril_jax.encoders import encoder
from gril_jax.encoders.encoder import AnyConfig, GraphConfig, Params
from gril_jax.encoders.ensemble import num_members, split, worst_distance
from gril_jax.errors import ConfigError, ShapeError
from gril_jax.graphs import activity
from gril_jax.graphs.scene import scene_graph
from gril_jax.losses.heads import Head
from gril_jax.types import DemoBatch, SceneGraph, checked


class RewardParams(NamedTuple):
    """Everything that the reward needs at run time; freeze it, save it, pass it on."""

    encoder: Params
    goal: Float[Array, "D"] | Float[Array, "G D"]  # one latent, or a set whose nearest counts
    scale: Float[Array, ""] | Float[Array, "K"]  # reward units per latent distance, of each member
    alpha: Float[Array, ""]  # weight of an active node in the pooling (Eq. 3)
    head: Head | None = None  # predicts progress, which is the reward in place of the distance
    start: Float[Array, "D"] | None = None  # with a head: the mean latent of first frames


@checked
def latent_goal_reward(
    params: RewardParams,
    graph: SceneGraph | Float[Array, "*batch height width 3"],
    config: AnyConfig,
) -> Float[Array, "*batch"]:
    """Minus the latent distance to the goal (Eq. 7): at most 0, and 0 at the goal.

    At the goal itself the gradient is zero, not NaN. With a head, whose progress may exceed the
    goal's, the reward may exceed 0.

    Args:
      params, config: from `from_demos` or `from_latents`, and of their encoder.
      graph: of one state; for `PixelConfig` RGB frames in [0, 1].

    Raises:
      ShapeError: the goal is not of the latent's size, or the input does not fit the config.
    """
    latent = encoder.apply(params.encoder, graph, config, alpha=params.alpha)
    return latent_reward(params, latent)


@checked
def latent_reward(
    params: RewardParams,
    latent: Float[Array, "*batch D"],
) -> Float[Array, "*batch"]:
    """The reward of latents that the encoder has already made.

    >>> params = RewardParams({}, goal=jnp.zeros(2), scale=jnp.float32(0.2), alpha=jnp.float32(5))
    >>> latent_reward(params, jnp.array([[3.0, 4.0], [0.0, 0.0]])).tolist()
    [-1.0, -0.0]

    Args:
      params: its `goal` and `scale` are used, and its `head` and `start` if it has them.
      latent: with any leading axes. Of an ensemble, whose `scale` is (K,), the distance from a goal
        is the largest of its members' scaled distances. Of a set of goals the nearest counts.

    Raises:
      ShapeError: the goal is not of the latent's size, or that is not a multiple of K.
    """
    goal, scale = params.goal, jnp.asarray(params.scale)
    _check_goal(goal, latent.shape[-1])
    if params.head is not None:
        there, here = (params.head.progress(x, params.start, goal) for x in (goal, latent))
        return scale * (here - there)
    if goal.ndim == 1:
        return -worst_distance(latent - goal, scale)
    return -jnp.min(worst_distance(latent[..., None, :] - goal, scale), axis=-1)


@checked
def from_latents(
    encoder_params: Params,
    first: Float[Array, "B D"],
    last: Float[Array, "B D"],
    *,
    alpha: Float[Array, ""] | float = PoolConfig.alpha,
    goals: int = 1,
    ensemble_size: int = 1,
    head: Head | None = None,
) -> RewardParams:
    """A reward from the latents of the demonstrations' first and last frames.

    >>> params = from_latents({}, first=jnp.array([[4.0]]), last=jnp.array([[2.0]]))
    >>> params.goal.tolist(), float(params.scale)
    ([2.0], 0.5)

    Args:
      encoder_params: what the latents were made with.
      first: of the first frames.
      last: of the last frames, with the task done.
      alpha: the pooling weight that they were made with.
      goals: 1 for the mean of the last latents; above 1 for a set of G of them, at equal steps in
        their order.
      ensemble_size: of the encoder that made them.
      head: predicts progress from them; for one goal, and no ensemble.

    Returns:
      Reward parameters, with scale = 1 / mean distance of `first` from the goal, of a set from
      the nearest one. If that distance is 0 there is nothing to scale by, and the scale is 1.
      Each member of an ensemble has a scale as if it were alone. With a head, the distance is how
      much more progress the goal has.

    Raises:
      ShapeError: there is no demonstration, or the latents' size is not a multiple of the number
        of members.
      ConfigError: `goals` is not from 1 to the number of demonstrations, or there is a head and
        `goals` or `ensemble_size` is above 1.
    """
    if 0 in last.shape or first.shape != last.shape:
        raise ShapeError(
            f"first has shape {first.shape} and last has shape {last.shape}; both must be "
            f"(demonstrations, latent), and not empty."
        )
    if not 1 <= goals <= len(last):
        raise ConfigError(
            f"goals is {goals}; it must be from 1 to {len(last)}, the number of demonstrations."
        )
    if head is not None and (goals, ensemble_size) != (1, 1):
        raise ConfigError(
            f"goals is {goals} and ensemble_size {ensemble_size}; with a head both must be 1."
        )
    if goals == 1:
        goal = jnp.mean(last, axis=0)
    else:
        goal = last[jnp.linspace(0, len(last) - 1, goals).round().astype(jnp.int32)]
    one = jnp.ones((), jnp.float32)
    start = None if head is None else jnp.mean(first, axis=0)
    alpha = jnp.asarray(alpha, jnp.float32)
    unscaled = RewardParams(encoder_params, goal, one, alpha, head, start)

    def scale(first, goal):
        distance = jnp.mean(-latent_reward(unscaled._replace(goal=goal), first))
        return 1.0 / jnp.where(distance > 0, distance, 1.0)

    if ensemble_size == 1:
        return unscaled._replace(scale=scale(first, goal))
    each = jax.vmap(scale, (-2, -2))(split(first, ensemble_size), split(goal, ensemble_size))
    return unscaled._replace(scale=each)


@checked
def from_demos(
    encoder_params: Params,
    demos: DemoBatch,
    config: GraphConfig,
    *,
    alpha: Float[Array, ""] | float = PoolConfig.alpha,
    active: Bool[Array, "B T N"] | None = None,
    goals: int = 1,
    head: Head | None = None,
) -> RewardParams:
    """The reward of a trained encoder, with goal and scale from its demonstrations.

    Args:
      encoder_params, config: of the trained encoder.
      demos: the training demonstrations; each must end with the task done.
      alpha: weight of an active node in the pooling (Eq. 3).
      active: activity bits, of the rule that rollouts will have; the paper's (Eq. 4) if left out.
      goals, head: as in `from_latents`.

    Returns:
      Reward parameters. If every demonstration begins where it ends, as far as the encoder can
      tell, there is no distance to scale by and the scale is 1.

    Raises:
      ShapeError: there is no demonstration, a length that is known is not from 1 to T, or `active`
        does not fit.
      ConfigError: the encoder is not one of scene graphs, or `goals` is out of its range.
    """
    _check_demos(demos, config, active)
    return _from_demos(encoder_params, demos, config, alpha, active, head, goals=goals)


@functools.partial(jax.jit, static_argnames="goals")
def _from_demos(encoder_params, demos, config, alpha, active, head, *, goals):
    alpha = jnp.asarray(alpha, jnp.float32)

    def ends(demo, active):
        latent = _embedding(encoder_params, demo, config, alpha, active)
        return latent(jnp.zeros_like(demo.length)), latent(demo.length - 1)

    first, last = jax.vmap(ends)(demos, active)
    size = num_members(config)
    return from_latents(
        encoder_params, first, last, alpha=alpha, goals=goals, ensemble_size=size, head=head
    )


@checked
def demo_latents(
    encoder_params: Params,
    demos: DemoBatch,
    config: GraphConfig,
    *,
    alpha: Float[Array, ""] | float = PoolConfig.alpha,
    active: Bool[Array, "B T N"] | None = None,
) -> Float[Array, "B T D"]:
    """The latent of every frame of every demonstration, padding included.

    One demonstration at a time is in memory. Arguments and errors are those of `from_demos`.
    """
    _check_demos(demos, config, active)
    return _demo_latents(encoder_params, demos, config, alpha, active)


@jax.jit
def _demo_latents(encoder_params, demos, config, alpha, active):
    def one(inputs):
        latent = _embedding(encoder_params, inputs[0], config, alpha, inputs[1])
        return jax.vmap(latent)(jnp.arange(demos.center.shape[1]))

    return jax.lax.map(one, (demos, active))


def _embedding(encoder_params, demo, config, alpha, active):
    """The latent of one demonstration as a function of the frame."""
    if active is None:
        active = activity.trajectory(demo.center, demo.size)

    def latent(frame):
        boxes = demo.center[frame], demo.size[frame]
        graph = scene_graph(*boxes, demo.label, demo.is_robot, active[frame], demo.present)
        return encoder.apply(encoder_params, graph, config, alpha=alpha)

    return latent


def _check_goal(goal, latent_size):
    if goal.ndim not in (1, 2) or 0 in goal.shape or goal.shape[-1] != latent_size:
        raise ShapeError(
            f"goal has shape {goal.shape}, but must be ({latent_size},) or (goals, {latent_size}) "
            f"for latents of size {latent_size}."
        )


def _check_demos(demos, config, active):
    if not isinstance(config, GraphConfig):
        raise ConfigError(
            f"config is a {type(config).__name__}, which takes no boxes; take `from_latents`."
        )
    shape = demos.center.shape[:3]
    if not shape[0] or not shape[1]:
        raise ShapeError(
            f"demos.center has shape {demos.center.shape}; it must hold one frame or more of one "
            f"demonstration or more."
        )
    if active is not None and active.shape != shape:
        raise ShapeError(f"active has shape {active.shape}; it must be {shape}, as demos.center.")
    if not isinstance(demos.length, jax.core.Tracer):
        with jax.ensure_compile_time_eval():
            if not jnp.all((demos.length >= 1) & (demos.length <= shape[1])):
                known = demos.length
                raise ShapeError(f"demos.length is {known}; it must be from 1 to {shape[1]}.")
