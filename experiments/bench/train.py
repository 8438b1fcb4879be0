"""The cost of training beside its environment alone: MatchRegions, five blocks, gripper.

    gril bench train                    two to eight minutes on 2 CPU cores

`steps_per_s` are control steps per second of all environments, of programs that take turns.
"random" is the simulator alone under random actions, without resets.
"""

import statistics
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs import Env

from gril_jax.compilation import sharding
from gril_jax.encoders import encoder
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.rl import ppo, rewards, training
from gril_jax.workflows.build import policy_rewards, setup

from .frame import InPlace, compile_timed, ratios, rounded, speeds, times_in_turn, without_cache


class Sizes(NamedTuple):
    """The sizes of everything that runs."""

    num_envs: int = 256
    unroll: int = 20
    updates: int = 1  # of a timed call
    hidden: tuple[int, ...] = (64, 64)
    width: int = 64  # of the encoder
    seed_num_envs: int = 64
    seed_updates: int = 4  # of each seed's whole training
    num_seeds: int = 8
    separate: int = 1  # seeds that are really run one by one


_GPU = Sizes(8192, updates=5, hidden=(256, 256), seed_num_envs=512, seed_updates=50, separate=2)


def main(
    *, num_envs: int | None, engine: str, variant: str, parts: Sequence[str], repeats: int
) -> dict[str, Any]:
    """The figures of some parts: "training", "seeds" and "devices"."""
    sizes = Sizes() if jax.default_backend() == "cpu" else _GPU
    sizes = sizes._replace(num_envs=num_envs or sizes.num_envs)
    task = {"variant": variant, "varied_starts": 0.5}
    env = setup.build("match_regions", task | {"engine": engine})
    task["engine"] = env.engine
    own = partial(_ppo, env, rewards.environmental, sizes)
    measured = {
        "training": lambda: costs(env, sizes, repeats),
        "seeds": lambda: seeds(
            own(sizes.seed_num_envs), sizes.num_seeds, sizes.seed_updates, sizes.separate
        ),
        "devices": lambda: devices(own, sizes.num_envs, sizes.updates, repeats),
    }
    return {"task": task, "sizes": sizes._asdict()} | {part: measured[part]() for part in parts}


def costs(env: Env, sizes: Sizes, repeats: int) -> dict[str, Any]:
    """Times PPO with either reward, and random actions, on the same environments."""
    config = encoder.EncoderConfig(len(env.classes), width=sizes.width)
    params = RewardParams(
        jax.jit(lambda key: encoder.init(key, config))(jax.random.key(0)),
        jnp.zeros(config.latent), jnp.float32(1), jnp.float32(1),
    )  # fmt: skip
    reward = rewards.learned(config, robots=policy_rewards.robots(env))
    learned = _ppo(env, reward, sizes, sizes.num_envs)
    own = _ppo(env, rewards.environmental, sizes, sizes.num_envs)
    calls = {
        "learned": _training(learned, sizes.updates, params),
        "environmental": _training(own, sizes.updates, None),
        "random": _random(env, sizes),
    }
    rounds = times_in_turn(calls, repeats)
    taken = {name: min(times) for name, times in rounds.items()}
    steps = sizes.updates * sizes.num_envs * sizes.unroll
    trained = ("learned", "environmental")

    def both(one: str, other: str) -> dict[str, float]:
        """Of the best calls, and the median over rounds, whose calls other loads hit alike."""
        middle = statistics.median(a / b for a, b in zip(rounds[one], rounds[other], strict=True))
        return {"best": taken[one] / taken[other], "median": middle}

    cost = both("environmental", "learned")
    return {
        "steps_per_s": {name: round(steps / taken[name]) for name in (*trained, "random")},
        "cost_of_learned_reward": {name: round(1 - value, 4) for name, value in cost.items()},
        "share_of_random": {
            name: {of: round(value, 3) for of, value in both("random", name).items()}
            for name in trained
        },
    }


def _ppo(env: Env, reward: rewards.AnyReward, sizes: Sizes, num_envs: int) -> ppo.PPO:
    minibatches = 4 if num_envs % 4 == 0 else 1
    static = ppo.Static(
        num_envs=num_envs, unroll_length=sizes.unroll, num_minibatches=minibatches,
        hidden=sizes.hidden,
    )  # fmt: skip
    return ppo.PPO(env, reward, static)


def _training(algorithm: ppo.PPO, updates: int, params: RewardParams | None) -> InPlace:
    """A program of updates, with hyper-parameters and reward as arguments, as in a run."""
    hyper = ppo.Hyper(*map(jnp.float32, ppo.Hyper()))

    def run(carry):
        state, hyper, params = carry
        state, *_ = training.chunk(algorithm, state, hyper, params, updates=updates)
        return state, hyper, params

    state = jax.jit(algorithm.init)(jax.random.key(0), hyper)
    return InPlace(run, (state, hyper, params))


def _random(env: Env, sizes: Sizes) -> InPlace:
    """A program of the simulator alone under random actions; its carry is the state and a key."""

    def move(carry, _):
        state, key = carry
        key, key_action = jax.random.split(key)
        action = jax.random.uniform(key_action, (sizes.num_envs, env.action_size), minval=-1.0)
        return (jax.vmap(env.step)(state, action), key), None

    def run(carry):
        return jax.lax.scan(move, carry, length=sizes.unroll * sizes.updates)[0]

    begun = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), sizes.num_envs))
    return InPlace(run, (begun, jax.random.key(1)))


def seeds(algorithm: training.Algorithm, num: int, updates: int, separate: int) -> dict[str, Any]:
    """Times seeds in one program, and one by one, of which the first `separate` are really run."""
    keys = jax.block_until_ready(jax.random.split(jax.random.key(0), num))
    with without_cache():
        together = _whole(jax.vmap, algorithm, keys, updates)
        alone = [_whole(lambda f: f, algorithm, key, updates) for key in keys[:separate]]
    each = {name: sum(part[name] for part in alone) / len(alone) for name in together}
    apart = {name: num * value for name, value in each.items()}
    return {
        "seeds": num,
        "steps_of_a_seed": updates * algorithm.num_envs * algorithm.unroll_length,
        "together_s": rounded(together),
        "one_by_one_s": rounded(apart),
        "one_by_one": f"{len(alone)} measured, times {num / len(alone):g}",
        "times_as_fast": round(sum(apart.values()) / sum(together.values()), 2),
        "times_as_fast_to_run": round(apart["run"] / together["run"], 2),
    }


def _whole(mapped, algorithm: training.Algorithm, key: Any, updates: int) -> dict[str, float]:
    """Seconds of a whole training in a fresh Python process."""
    jax.clear_caches()
    hyper = ppo.Hyper()

    def run(state):
        return training.chunk(algorithm, state, hyper, None, updates=updates)[0]

    start = time.perf_counter()
    state = jax.jit(mapped(partial(algorithm.init, hyper=hyper)))(key)
    advance, _ = compile_timed(mapped(run), state, donate_argnums=0)
    jax.block_until_ready(state)
    compiled = time.perf_counter()
    jax.block_until_ready(advance(state))
    return {"compile": compiled - start, "run": time.perf_counter() - compiled}


def devices(
    make: Callable[[int], training.Algorithm], num_envs: int, updates: int, repeats: int
) -> dict[str, Any] | None:
    """One device and all, with as many environments on each; None where there is only one."""
    every = jax.devices()
    if len(every) == 1:
        return None
    small, large = make(num_envs), make(len(every) * num_envs)
    cases = {
        "one": (small, every[:1], 1),
        "all_one_seed": (large, every, 1),
        "all_a_seed_each": (small, every, len(every)),
    }
    calls = {name: _spread(*case, updates) for name, case in cases.items()}
    steps = {
        name: count * updates * algorithm.num_envs * algorithm.unroll_length
        for name, (algorithm, _, count) in cases.items()
    }
    speed = speeds(calls, steps, repeats)
    return {
        "devices": len(every),
        "environments_on_each": num_envs,
        "steps_per_s": rounded(speed, 0),
        "times_one": ratios(speed, "one"),
    }


def _spread(algorithm: training.Algorithm, on: Sequence[Any], count: int, updates: int):
    layout = sharding.mesh(on, seeds=count, num_envs=algorithm.num_envs)
    each = jax.tree.map(lambda x: jnp.full((count,), x, jnp.float32), ppo.Hyper())
    hyper = sharding.place(layout, each)
    keys = jax.random.split(jax.random.key(0), count)
    state = sharding.init(algorithm, layout, keys, hyper)
    run, shapes = sharding.advance(algorithm, layout, state, hyper, None, updates)
    part, numbers = sharding.begun(state, shapes), map(np.int32, (0, updates, updates))
    numbers = [*numbers]

    def call():
        nonlocal part
        part, _ = run(part, hyper, None, *numbers)
        return part

    return call
