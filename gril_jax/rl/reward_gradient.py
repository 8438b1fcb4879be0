"""The gradient of a learned reward, for a policy to observe: where each object should go.

The value of a reward says how far a scene is from its goal. Its gradient with respect to the centre
of an object also says which object to move, and which way. In another layout, which the videos do
not show, this direction is another one, but what a policy has to do about it stays the same. It
follows from boxes and the reward's file, so it is there wherever the reward is.

Shapes use N for the task's objects, in its order.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .rewards import AnyReward, Reward, RewardFn, as_reward

_LEAST = 1e-3  # reward per world unit: where no gradient is longer, nothing is to be gained


class _Boxes(NamedTuple):
    """The objects of a task's state, as far as rewards read them."""

    center: Any
    size: Any
    label: Any
    is_robot: Any


class _State(NamedTuple):
    """The part of a task's state that a learned reward reads."""

    objects: _Boxes


def observed(reward: AnyReward, value: RewardFn, objects: int) -> Reward:
    """The same reward, whose gradient the policy sees before whatever else it sees of its memory.

    Args:
      reward: what the policy is trained on.
      value: the learned reward in it, of the same parameters.
      objects: N.

    Returns:
      A reward that observes 2 N more numbers: those of `directions`, zeros before the first step.
    """
    own = as_reward(reward)

    def step(params, memory, state, active):
        remembered, found = own.step(params, memory[1], state, active)
        return (directions(value, params, state, active), remembered), found

    return Reward(
        init=lambda: (jnp.zeros((objects, 2)), own.init()),
        step=step,
        observe=lambda memory: jnp.concatenate([memory[0].reshape(-1), own.observe(memory[1])]),
    )


def directions(
    value: RewardFn, params: Any, state: Any, active: Bool[Array, "N"]
) -> Float[Array, "N 2"]:
    """The reward's gradient with respect to each centre, in units of the longest: the object that
    gains most per distance has length 1.

    It is 0 for an object without an extent, which is not there, and where it is not finite.
    """
    seen = jax.tree.map(jnp.asarray, state.objects)

    def reward(center):
        boxes = _Boxes(center, seen.size, seen.label, seen.is_robot)
        return value(params, _State(boxes), active)

    slope = jax.grad(reward)(seen.center)
    there = (seen.size > 0).any(axis=1, keepdims=True)
    slope = jnp.where(there & jnp.isfinite(slope), slope, 0.0)
    longest = jnp.sqrt(jnp.max(jnp.sum(slope**2, axis=1)))
    return slope / jnp.maximum(longest, _LEAST)
