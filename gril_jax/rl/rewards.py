"""Rewards that a policy can be trained on: pure functions of an episode's states.

A plain reward is a function `(params, state, active) -> reward` of one state. A reward that must
remember something of its episode is a `Reward`, whose memory is forgotten when the episode ends.
Wherever a reward is asked for, either will do.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, UInt8

from gril_jax.encoders import encoder, resnet
from gril_jax.encoders.encoder import GraphConfig, PixelConfig
from gril_jax.graphs.scene import SceneGraph, scene_graph
from gril_jax.reward import shaping, staircase
from gril_jax.reward.latent_goal import latent_goal_reward
from gril_jax.reward.learned_reward import LearnedReward

# (parameters, environment state, activity bits (N,)) -> reward of this state.
RewardFn = Callable[[Any, Any, Bool[Array, "N"]], Float[Array, ""]]


class Reward(NamedTuple):
    """A reward with a memory of the episode, which is any pytree of arrays."""

    init: Callable[[], Any]  # the memory at an episode's start
    # (parameters, memory, environment state, activity bits (N,)) -> (memory, reward).
    step: Callable[[Any, Any, Any, Bool[Array, "N"]], tuple[Any, Float[Array, ""]]]
    observe: Callable[[Any], Float[Array, "K"]]  # what of the memory the policy should see


AnyReward = RewardFn | Reward


def as_reward(reward: AnyReward) -> Reward:
    """The reward itself, or a plain one wrapped as a `Reward` without memory."""
    if isinstance(reward, Reward):
        return reward
    return Reward(
        init=lambda: (),
        step=lambda params, memory, state, active: (memory, reward(params, state, active)),
        observe=lambda memory: jnp.zeros((0,)),
    )


def environmental(params: Any, state: Any, active: Bool[Array, "N"]) -> Float[Array, ""]:
    """The task's own dense reward; it has no parameters."""
    del params, active
    return state.reward


def learned(config: GraphConfig, *, robots: Sequence[int] = ()) -> RewardFn:
    """The latent-goal reward (Eq. 7) of the objects that a detector would see.

    Its parameters are a `RewardParams`: an argument, not a constant of the program, so that the
    seeds of a sweep can each have their own.

    Args:
      config: of the encoder.
      robots: objects that belong to the robot, as `is_robot` says of each state. Where they are
        known beforehand, an encoder that does not look at them is spared their nodes.
    """
    scene = _scene(config, robots)

    def reward(params: Any, state: Any, active: Bool[Array, "N"]) -> Float[Array, ""]:
        return jnp.asarray(latent_goal_reward(params, scene(state, active), config))

    return reward


def saved(params: LearnedReward, state: Any, active: Bool[Array, "N"]) -> Float[Array, ""]:
    """The reward of a file (`gril_jax.load_reward`), which is its own parameters.

    Its `objects` are those of the task, in the task's order; without any, labels and robot flags
    are those of each state. Raises ShapeError if the encoder looks at more than one frame.
    """
    seen = state.objects
    own = {} if params.objects else {"label": seen.label, "is_robot": seen.is_robot}
    return params(seen.center, seen.size, active, **own)


def offset(reward: RewardFn, by: float) -> RewardFn:
    """The reward plus a constant, which favours no policy in episodes of equal length.

    It may speed up learning: initial values of 0 then fit states whose reward is 0.
    """

    def more(params: Any, state: Any, active: Bool[Array, "N"]) -> Float[Array, ""]:
        return reward(params, state, active) + by

    return more if by else reward


def pixels(
    config: PixelConfig,
    render: Callable[[Any], UInt8[Array, "P P 3"]],
    *,
    side_by_side: bool = False,
) -> RewardFn:
    """XIRL's reward: the latent-goal reward (Eq. 7) of a picture of each state.

    Its parameters are a `RewardParams`, as those of `learned`. The activity bits do not count.

    Args:
      config: of the encoder.
      render: from the simulator's data to the picture, of the size of the encoder's frames.
      side_by_side: a vmap over parameters, as over the seeds of a sweep, becomes grouped
        convolutions, which can be spread over devices. Else one encoder runs after the other,
        which is faster on a device and needs the memory of one.
    """

    @jax.custom_batching.custom_vmap
    def value(params, frames):  # of 8 bits, so that the frames of all lanes wait in a quarter
        return jnp.asarray(latent_goal_reward(params, resnet.floats(frames), config))

    @value.def_vmap
    def _(size, batched, params, frames):
        params_batched, frames_batched = batched
        if not any(jax.tree.leaves(params_batched)):
            return value(params, frames), True  # one more axis of frames
        spread = lambda x, has: x if has else jnp.broadcast_to(x, (size, *x.shape))  # noqa: E731
        each = jax.tree.map(spread, (params, frames), (params_batched, frames_batched))
        return jax.lax.map(lambda pair: value(*pair), each), True

    def reward(params: Any, state: Any, active: Bool[Array, "N"]) -> Float[Array, ""]:
        del active
        frame = render(state.data)
        if side_by_side:
            return jnp.asarray(latent_goal_reward(params, resnet.floats(frame), config))
        return value(params, frame)

    return reward


def stages(config: GraphConfig, *, robots: Sequence[int] = (), by: float = 0.0) -> Reward:
    """The learned reward in the stages in which it climbs (`gril_jax.reward.staircase`).

    Its parameters are a pair: those of `learned`, and the stages. The policy sees the share of
    the stages that are finished. `robots` are those of `learned`, `by` is that of `offset`.
    """
    reward = learned(config, robots=robots)

    def step(params, memory, state, active):
        own, stairs = params
        progress, paid = staircase.step(stairs, memory[0], reward(own, state, active))
        share = progress.index / jnp.maximum(stairs.count, 1)
        return (progress, share.astype(jnp.float32)), paid + by

    return Reward(
        init=lambda: (staircase.init(), jnp.zeros(())),
        step=step,
        observe=lambda memory: memory[1][None],
    )


def shaped(potential: RewardFn) -> Reward:
    """The task's own reward, with a learned one as its shaping potential.

    Of a step from s to s' it is `w0 * (discount * phi(s') - phi(s)) + w1 * own`, where phi is the
    potential (`gril_jax.reward.shaping`): the best policies are those of the task's own reward.
    Its parameters are `(weights (2,), the learner's discount, those of the potential)`.

    A reward does not see the state that an episode begins in, so the first potential counts as -1.
    That is the mean learned reward where demonstrations begin. As a constant it depends on
    no action, and so it keeps the best policies too (Devlin and Kudenko, AAMAS 2012).
    """

    def step(params, before, state, active):
        weights, discount, own = params
        after = potential(own, state, active)
        guide = shaping.step(before, after, state.done, discount=discount)
        return after, weights[0] * guide + weights[1] * state.reward

    return Reward(init=lambda: -jnp.ones(()), step=step, observe=lambda memory: jnp.zeros((0,)))


def _scene(
    config: GraphConfig, robots: Sequence[int]
) -> Callable[[Any, Bool[Array, "N"]], SceneGraph]:
    """Returns (state, activity bits) -> the graph of all objects that the encoder looks at."""
    unseen = () if encoder.sees_robot(config) else tuple(robots)

    def scene(state, active):
        seen = jax.tree.map(jnp.asarray, state.objects)
        nodes = seen.center, seen.size, seen.label, seen.is_robot, active
        if unseen:
            kept = [i for i in range(len(active)) if i not in unseen]
            nodes = tuple(jnp.stack([x[i] for i in kept]) for x in nodes)
        return scene_graph(*nodes)

    return scene
