"""Evaluation of a policy: whole episodes from starts that have been sampled before.

    begun = begin(algorithm.episodes, key_begin, episodes=256)
    found = evaluate(algorithm, policy, reward_params, begun, key, tau=tau, deterministic=True)

Starts are an argument: one compiled program serves all variants of a task whose episodes differ in
nothing but how they begin.
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from .episodes import Episodes, EpisodeState, reset_where
from .policy import Policy
from .rollout import strong
from .training import Algorithm


class Evaluation(NamedTuple):
    """E episodes of T control steps; frame 0 of `states` is the reset."""

    states: Any  # environment states, leaves (E, T + 1, ...)
    reward: Float[Array, "E T"]  # what the policy was trained on
    success: Float[Array, "E"]  # at the end of the episode
    success_ever: Float[Array, "E"]  # at some time in it
    score: Float[Array, "E"]  # at the end
    remembered: Float[Array, "E T K"]  # what the policy sees of the reward's memory, after a step


@functools.partial(jax.jit, static_argnums=(0,), static_argnames=("episodes",))
def begin(of: Episodes, key: PRNGKeyArray, *, episodes: int) -> EpisodeState:
    """So many episodes at their starts, leaves (E, ...). The key is consumed."""
    begun = jax.vmap(of.begin)(jax.random.split(key, episodes))
    return jax.tree.map(strong, begun)  # or `evaluate` compiles once more for a task's weak types


@functools.partial(jax.jit, static_argnums=(0,))
def evaluate(
    algorithm: Algorithm,
    policy: Policy,
    reward_params: Any,
    begun: EpisodeState,
    key: PRNGKeyArray,
    *,
    tau: Float[Array, ""] | float,
    deterministic: Bool[Array, "*E"] | bool = True,
) -> Evaluation:
    """Runs the policy through the episodes begun, leaves (E, ...), in parallel.

    The key is consumed. `deterministic` says, of all episodes or of each, whether the policy's mean
    actions are played or samples; it may be traced.
    An episode that the task ends stays where it ended, without further reward. One whose simulation
    fails stays where it was before the failure.
    """
    of, episodes = algorithm.episodes, len(begun.time)
    means = jnp.broadcast_to(deterministic, (episodes,))

    def one(episode, key, deterministic):
        mean = algorithm.act(policy, episode, key, deterministic=True)
        sample = algorithm.act(policy, episode, key, deterministic=False)
        action = jnp.where(deterministic, mean, sample)
        return of.advance(reward_params, episode, action, tau=tau)

    def move(carry, key):
        before, over, *rates = carry
        moved, result = jax.vmap(one)(before, jax.random.split(key, episodes), means)
        running = jax.vmap(reset_where)(over, before, moved)
        seen = jax.vmap(lambda one: of.reward.observe(one.reward_memory))(running)
        now = result.metrics["success"], result.metrics["score"]
        success, score = (jnp.where(over, *pair) for pair in zip(rates, now, strict=True))
        reward = jnp.where(over, 0.0, result.reward)
        over |= result.terminated + result.nonfinite > 0
        return (running, over, success, score), (running.state, reward, success, seen)

    nothing = jnp.zeros((episodes,))
    carry, steps = jax.lax.scan(
        move,
        (begun, nothing > 0, nothing, nothing),
        jax.random.split(key, of.env.episode_length),
    )
    states, reward, success, seen = steps
    states = jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), begun.state, states)
    return Evaluation(
        states=jax.tree.map(lambda x: jnp.swapaxes(x, 0, 1), states),
        reward=reward.T,
        success=success[-1],
        success_ever=success.max(axis=0),
        score=carry[-1],
        remembered=jnp.swapaxes(seen, 0, 1),
    )
