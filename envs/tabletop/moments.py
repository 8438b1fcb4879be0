"""Snapshots from recorded episodes, as starting states of training episodes.

A task of several stages is hardly ever finished by chance. Where some episodes begin when part of
it is done, each stage is met from the first update on (Nair et al. 2018, Salimans and Chen 2018).
What is used of a recording is the simulator's state; nobody imitates its actions.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

__all__ = ["Moments", "draw"]


class Moments(NamedTuple):
    """P snapshots of any episodes; or one of them, without the axis P."""

    qpos: Float[Array, "*P Q"]
    qvel: Float[Array, "*P V"]
    target: Float[Array, "*P 8"]  # the servos' aims: joints, opening of a finger
    fixtures: Float[Array, "*P M 7"]
    reached: Bool[Array, "*P K"]  # stages that have held by then
    best: Int[Array, "*P"]  # most stages that have been done at once by then
    moved: Bool[Array, "*P N"]  # objects that have moved by then


def draw(key: PRNGKeyArray, moments: Moments) -> Moments:
    """Samples one of them uniformly. The key is consumed."""
    at = jax.random.randint(key, (), 0, len(moments.best))
    return jax.tree.map(lambda x: jnp.asarray(x)[at], moments)
