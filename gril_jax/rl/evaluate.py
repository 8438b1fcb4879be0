"""Evaluation of a policy: whole episodes from the task's own starts."""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from .policy import Policy
from .training import Algorithm


class Evaluation(NamedTuple):
    """E episodes of T control steps; frame 0 of `states` is the reset."""

    states: Any  # environment states, leaves (E, T + 1, ...)
    reward: Float[Array, "E T"]  # what the policy was trained on
    success: Float[Array, "E"]  # at the end of the episode
    success_ever: Float[Array, "E"]  # at some moment of it
    score: Float[Array, "E"]  # at the end


@functools.partial(jax.jit, static_argnums=(0,), static_argnames=("episodes",))
def evaluate(
    algorithm: Algorithm,
    policy: Policy,
    reward_params: Any,
    key: PRNGKeyArray,
    *,
    tau: Float[Array, ""] | float,
    episodes: int,
    deterministic: Bool[Array, ""] | bool = True,
) -> Evaluation:
    """Runs the policy for `episodes` episodes, in parallel. The key is consumed.

    `deterministic` may be traced: one program plays the trained policy's mean actions and, to
    compare, the samples of an untrained one.
    An episode whose simulation fails stays where it was before the failure.
    """
    key_begin, key_act = jax.random.split(key)
    of = algorithm.episodes
    running = jax.vmap(of.begin)(jax.random.split(key_begin, episodes))

    def one(episode, key):
        mean = algorithm.act(policy, episode, key, deterministic=True)
        sample = algorithm.act(policy, episode, key, deterministic=False)
        action = jnp.where(deterministic, mean, sample)
        return of.advance(reward_params, episode, action, tau=tau)

    def move(running, key):
        running, result = jax.vmap(one)(running, jax.random.split(key, episodes))
        return running, (running.state, result)

    steps = jax.random.split(key_act, of.env.episode_length)
    _, (states, results) = jax.lax.scan(move, running, steps)
    states = jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), running.state, states)
    success = results.metrics["success"]
    return Evaluation(
        states=jax.tree.map(lambda x: jnp.swapaxes(x, 0, 1), states),
        reward=results.reward.T,
        success=success[-1],
        success_ever=success.max(axis=0),
        score=results.metrics["score"][-1],
    )
