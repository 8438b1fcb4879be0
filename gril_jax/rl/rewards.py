"""Rewards that a policy can be trained on: pure functions of one moment of an episode."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..encoder import GraphConfig
from ..graphs import scene_graph
from ..reward import latent_goal_reward

__all__ = ["RewardFn", "environmental", "learned"]

# (parameters, environment state, activity bits (N,)) -> reward of this moment.
RewardFn = Callable[[Any, Any, Bool[Array, "N"]], Float[Array, ""]]


def environmental(params: Any, state: Any, active: Bool[Array, "N"]) -> Float[Array, ""]:
    """The task's own dense reward; takes no parameters."""
    del params, active
    return state.reward


def learned(config: GraphConfig) -> RewardFn:
    """The latent-goal reward (Eq. 7) of what a detector would see.

    Its parameters are a `RewardParams`: an argument, not a constant of the program, so that the
    seeds of a sweep can each have their own.
    """

    def reward(params: Any, state: Any, active: Bool[Array, "N"]) -> Float[Array, ""]:
        seen = state.objects
        graph = scene_graph(seen.center, seen.size, seen.label, seen.is_robot, active)
        return jnp.asarray(latent_goal_reward(params, graph, config))

    return reward
