"""What training costs beside its environment alone, as JSON: MatchRegions, five blocks, gripper.

    gril bench train                    two to eight minutes on 2 CPU cores

`steps_per_s` are control steps per second of all environments, of programs that take turns; the
best of some calls after one to warm up counts. "random" is the simulator alone under random
actions, without resets. Ratios are named for what they say, and stand beside what they are of.
"""

import contextlib
import functools
import io
import json
import statistics
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from gril_jax.experiments.pipeline import policy_rewards, setup

from gril_jax import envs
from gril_jax.encoders import encoder
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.rl import episodes as env_loop
from gril_jax.rl import ppo, rewards, rollout, training

from . import seeds
from .clock import compile_timed, times_in_turn

__all__ = ["Sizes", "costs", "main", "starts"]


class Sizes(NamedTuple):
    """What is run."""

    lanes: int = 256
    unroll: int = 20
    updates: int = 1  # of a timed call
    hidden: tuple[int, ...] = (64, 64)
    width: int = 64  # of the encoder
    seed_lanes: int = 64
    seed_updates: int = 4  # of each seed's whole training
    num_seeds: int = 8
    separate: int = 1  # seeds that are really run one by one


_GPU = Sizes(lanes=8192, updates=5, hidden=(256, 256), seed_lanes=512, seed_updates=50, separate=2)
PARTS = ("training", "starts", "seeds", "devices")


def main(
    sizes: dict[str, Any],
    repeats: int,
    *,
    parts: Sequence[str] = PARTS,
    echo: Callable[[str], None],
    **task: Any,
) -> None:
    """Echo the figures as JSON.

    Args:
      sizes: fields of `Sizes` that are not as this platform has them.
      repeats: timed calls of each program, of which the best counts.
      parts: what to measure, of `PARTS`; `devices` only where there are several.
      echo: takes the JSON.
      task: options of MatchRegions.
    """
    chosen = (Sizes() if jax.default_backend() == "cpu" else _GPU)._replace(**sizes)
    with contextlib.redirect_stdout(io.StringIO()):  # mjx reports on optional parts
        env = envs.make("match_regions", **task)
    measured = {
        "training": lambda: costs(env, chosen, repeats),
        "starts": lambda: starts(env, chosen, repeats),
        "seeds": lambda: _seeds(env, chosen),
        "devices": lambda: _devices(env, chosen, repeats),
    }
    result: dict[str, Any] = {
        "device": setup.device_in_words(), "jax": jax.__version__, "task": task,
        "sizes": chosen._asdict(),
    }  # fmt: skip
    echo(json.dumps(result | {part: measured[part]() for part in parts}, indent=2))


def _seeds(env: Any, sizes: Sizes) -> dict[str, Any]:
    algorithm = _ppo(env, rewards.environmental, sizes, sizes.seed_lanes)
    return seeds.seeds(algorithm, sizes.num_seeds, sizes.seed_updates, sizes.separate)


def _devices(env: Any, sizes: Sizes, repeats: int) -> dict[str, Any] | None:
    if jax.device_count() == 1:
        return None
    own = functools.partial(_ppo, env, rewards.environmental, sizes)
    return seeds.devices(own, sizes.lanes, sizes.updates, repeats)


# ---------------------------------------------------------------- the reward, the learner


def costs(env: Any, sizes: Sizes, repeats: int) -> dict[str, Any]:
    """PPO with either reward beside random actions, all with the same environments."""
    config = encoder.EncoderConfig(len(env.classes), width=sizes.width)
    params = RewardParams(
        jax.jit(lambda key: encoder.init(key, config))(jax.random.key(0)),
        jnp.zeros(config.latent), jnp.float32(1), jnp.float32(1),
    )  # fmt: skip
    learned = _ppo(
        env, rewards.learned(config, robots=policy_rewards.robots(env)), sizes, sizes.lanes
    )
    own = _ppo(env, rewards.environmental, sizes, sizes.lanes)
    calls = {
        "learned": _Call(*_training(learned, sizes.updates, params)),
        "environmental": _Call(*_training(own, sizes.updates, None)),
        "random": _Call(*_random(env, sizes)),
    }
    calls["learn"] = _Call(*_learning(own))
    rounds = times_in_turn(calls, repeats)
    taken = {name: min(times) for name, times in rounds.items()}
    steps = sizes.updates * sizes.lanes * sizes.unroll
    names = ("learned", "environmental", "random")
    return {
        "steps_per_s": {name: round(steps / taken[name]) for name in names},
        "cost_of_learned_reward": {
            "best": round(1 - taken["environmental"] / taken["learned"], 4),
            "median": round(1 - _ratio(rounds, "environmental", "learned"), 4),
        },
        "share_of_random": {
            name: {
                "best": round(taken["random"] / taken[name], 3),
                "median": round(_ratio(rounds, "random", name), 3),
            }
            for name in ("learned", "environmental")
        },
        "learning_share_of_an_update": round(
            sizes.updates * taken["learn"] / taken["environmental"], 3
        ),
    }


def _ratio(rounds: dict[str, list[float]], one: str, other: str) -> float:
    """Median over rounds, whose calls were a moment apart: other loads hit both alike."""
    return statistics.median(a / b for a, b in zip(rounds[one], rounds[other], strict=True))


def _ppo(env: Any, reward: rewards.AnyReward, sizes: Sizes, lanes: int) -> ppo.PPO:
    minibatches = 4 if lanes % 4 == 0 else 1
    static = ppo.Static(
        num_envs=lanes, unroll_length=sizes.unroll, num_minibatches=minibatches,
        hidden=sizes.hidden,
    )  # fmt: skip
    return ppo.PPO(env, reward, static)


def _training(algorithm: ppo.PPO, updates: int, params: Any):
    """Updates; hyper-parameters and reward are arguments, as in a run, and no constants."""
    hyper = ppo.Hyper(*map(jnp.float32, ppo.Hyper()))

    def run(carry):
        state, hyper, params = carry
        state, *_ = training.chunk(algorithm, state, hyper, params, updates=updates)
        return state, hyper, params

    return run, (jax.jit(algorithm.init)(jax.random.key(0), hyper), hyper, params)


def _random(env: Any, sizes: Sizes):
    """The simulator alone; its state, and a key."""

    def move(carry, _):
        state, key = carry
        key, key_action = jax.random.split(key)
        action = jax.random.uniform(key_action, (sizes.lanes, env.action_size), minval=-1.0)
        return (jax.vmap(env.step)(state, action), key), None

    def run(carry):
        return jax.lax.scan(move, carry, length=sizes.unroll * sizes.updates)[0]

    begun = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), sizes.lanes))
    return run, (begun, jax.random.key(1))


def _learning(algorithm: ppo.PPO):
    """What an update learns from an unroll, by itself; the numbers are as good as any."""
    hyper, key = ppo.Hyper(), jax.random.key(2)
    exploring = jnp.zeros((algorithm.num_envs,), bool)

    def collect(state):
        return algorithm.collect(state, key, hyper, None, deterministic=exploring)[1]

    def learn(carry):
        state, steps = carry
        return algorithm.learn(state, steps, key, hyper, None)[0], steps

    state = jax.jit(algorithm.init)(key, hyper)
    shapes = jax.eval_shape(collect, state)
    return learn, (state, jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes))


class _Call:
    """A compiled program that each call moves on, in place."""

    def __init__(self, run: Callable[[Any], Any], state: Any):
        self._run, _ = compile_timed(run, state, donate_argnums=0)
        self._state = state

    def __call__(self) -> Any:
        self._state = self._run(self._state)
        return self._state


# ---------------------------------------------------------------- where starts come from


def starts(env: Any, sizes: Sizes, repeats: int) -> dict[str, Any]:
    """The pool of starts beside one for each environment an unroll, or even a step."""
    episodes = env_loop.Episodes.of(env, rewards.environmental)
    drawn = {
        "pool": rollout.renewals(sizes.lanes, sizes.unroll, env.episode_length),
        "each_unroll": sizes.lanes,
        "each_step": sizes.lanes * sizes.unroll,
    }
    keys = jax.random.split(jax.random.key(0), 2 * sizes.lanes)
    begun = jax.jit(lambda keys: rollout.init(episodes, keys))(keys)
    # A buffer is donated once, so each has its own.
    calls = {
        name: _Call(_starting(episodes, name, drawn[name], sizes), jax.tree.map(jnp.copy, carry))
        for name in drawn
        for carry in [(begun, jax.random.key(1))]
    }
    taken = {name: min(times) for name, times in times_in_turn(calls, repeats).items()}
    return {
        "starts_an_unroll": drawn,
        "steps_per_s": {n: round(sizes.lanes * sizes.unroll / s) for n, s in taken.items()},
        "pool_times_as_fast": {n: round(s / taken["pool"], 2) for n, s in taken.items()},
    }


def _starting(episodes: env_loop.Episodes, way: str, count: int, sizes: Sizes):
    """One unroll under random actions, with starts drawn in one of the three ways."""

    def act(observation, key):
        size = len(observation), episodes.env.action_size
        return jax.random.uniform(key, size, minval=-1.0), ()

    def one(lane, action):
        return episodes.advance(None, lane, action, tau=0.005)

    def move(lanes, key):
        key_start, key_action = jax.random.split(key)
        fresh = jax.vmap(episodes.begin)(jax.random.split(key_start, sizes.lanes))
        action, _ = act(jax.vmap(episodes.observe)(lanes), key_action)
        lanes, moment = jax.vmap(one)(lanes, action)
        ended = moment.terminated + moment.truncated > 0
        return jax.vmap(env_loop.reset_where)(ended, fresh, lanes), moment.reward

    def plain(carry):
        now, key = carry
        key, key_steps = jax.random.split(key)
        lanes, _ = jax.lax.scan(move, now.running, jax.random.split(key_steps, sizes.unroll))
        return now._replace(running=lanes), key

    def pooled(carry):
        now, key = carry
        key, key_renew, key_steps = jax.random.split(key, 3)
        now = rollout.renew(episodes, now, jax.random.split(key_renew, count))
        keys = jax.random.split(key_steps, sizes.unroll)
        now, _ = rollout.unroll(episodes, None, now, act, keys, tau=0.005)
        return now, key

    return plain if way == "each_step" else pooled
