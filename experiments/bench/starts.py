"""The pool of starts beside a start for each environment in every step.

`gril bench train` has these figures among its own.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from gril_jax.envs import Env

from gril_jax.rl import episodes as env_loop
from gril_jax.rl import rewards, rollout

from .frame import InPlace, best, ratios, times_in_turn


def starts(env: Env, num_envs: int, unroll: int, repeats: int) -> dict[str, Any]:
    """Steps per second with each way to make starts."""
    episodes = env_loop.Episodes.of(env, rewards.environmental)
    drawn = {
        "pool": rollout.renewals(num_envs, unroll, env.episode_length),
        "each_step": num_envs * unroll,
    }
    keys = jax.random.split(jax.random.key(0), 2 * num_envs)
    begun = jax.jit(lambda keys: rollout.init(episodes, keys))(keys), jax.random.key(1)
    runs = {
        "pool": _pooled(episodes, drawn["pool"], unroll),
        "each_step": _in_each_step(episodes, num_envs, unroll),
    }
    # A buffer is donated once, so each has its own.
    calls = {name: InPlace(run, jax.tree.map(jnp.copy, begun)) for name, run in runs.items()}
    taken = best(times_in_turn(calls, repeats))
    return {
        "starts_an_unroll": drawn,
        "steps_per_s": {n: round(num_envs * unroll / s) for n, s in taken.items()},
        "pool_times_as_fast": ratios(taken, "pool"),
    }


def _act(episodes: env_loop.Episodes, observation: Any, key: Any) -> tuple[Any, Any]:
    size = len(observation), episodes.env.action_size
    return jax.random.uniform(key, size, minval=-1.0), ()


def _pooled(episodes: env_loop.Episodes, count: int, unroll: int) -> Callable[[Any], Any]:
    """One unroll under random actions, before which so many starts are made."""

    def run(carry):
        now, key = carry
        key, key_renew, key_steps = jax.random.split(key, 3)
        now = rollout.renew(episodes, now, jax.random.split(key_renew, count))
        keys = jax.random.split(key_steps, unroll)
        now, _ = rollout.unroll(episodes, None, now, partial(_act, episodes), keys, tau=0.005)
        return now, key

    return run


def _in_each_step(episodes: env_loop.Episodes, num_envs: int, unroll: int) -> Callable[[Any], Any]:
    """One unroll under random actions, with a start for each environment in each step."""

    one = partial(episodes.advance, None, tau=0.005)

    def move(running, key):
        key_start, key_action = jax.random.split(key)
        fresh = jax.vmap(episodes.begin)(jax.random.split(key_start, num_envs))
        action, _ = _act(episodes, jax.vmap(episodes.observe)(running), key_action)
        running, result = jax.vmap(one)(running, action)
        ended = result.terminated + result.truncated > 0
        return jax.vmap(env_loop.reset_where)(ended, fresh, running), result.reward

    def run(carry):
        now, key = carry
        key, key_steps = jax.random.split(key)
        running, _ = jax.lax.scan(move, now.running, jax.random.split(key_steps, unroll))
        return now._replace(running=running), key

    return run
