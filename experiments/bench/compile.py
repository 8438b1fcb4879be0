"""Seconds to trace and to compile each program of a run, and how many programs it has.

    gril bench compile                  five minutes on 2 CPU cores

The programs are those of `gril quickstart`, compiled without the persistent cache and never run. A
small run of the whole pipeline then counts what XLA is given, with an empty cache and once more.
"""

import functools
import tempfile
import time
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from gril_jax.envs import Env

from gril_jax.config import RunConfig
from gril_jax.config.files import load
from gril_jax.config.tables import ALGORITHMS
from gril_jax.pretraining import pretrain
from gril_jax.rl import evaluate, training
from gril_jax.types import DemoBatch
from gril_jax.workflows.build import policy_setup, setup

from .frame import in_new_process, rounded, staged, without_cache


class Program(NamedTuple):
    """One program that a run compiles."""

    name: str
    function: Any  # jitted
    args: tuple[Any, ...]  # shapes will do
    options: Mapping[str, Any] = {}  # static ones
    brief: bool = False  # see `gril_jax.compilation.compiler`


_SMALL = """--demos.num 6 --demos.num-validation 2 --demos.num-failures 2 --pretrain.steps 20
--pretrain.num-videos 4 --encoder.width 16 --encoder.latent 8
--env.episode-length 90 --ppo.num-envs 16 --ppo.unroll-length 5 --ppo.num-timesteps 160
--ppo.hidden 16 --run.updates-per-chunk 1 --run.eval-episodes 4""".split()


def main(*, config: str) -> dict[str, Any]:
    """The figures of the programs of a configuration, and of small runs."""
    runs = small_runs(_SMALL)  # before this process takes a GPU's memory
    with without_cache():
        found = {one.name: timed(one) for one in programs(load(config))}
    return {"config": config, "small_run": runs, "programs": found}


def timed(program: Program) -> dict[str, float]:
    """Seconds of tracing and lowering, and of XLA's compilation."""
    made = staged(program.function, program.args, brief=program.brief, **program.options)
    return {"trace_s": round(made[1], 2), "compile_s": round(made[2], 2)}


def programs(config: RunConfig) -> Iterator[Program]:
    """The programs of a run, for each algorithm."""
    env = setup.make_env(config.env, training=True)
    task = setup.make_env(config.env, training=False)
    yield from _of_pretraining(config, env)
    reward = jax.eval_shape(lambda: setup.blank_reward(config, len(env.classes)))
    key = jax.eval_shape(lambda: jax.random.key(0))
    for name in ALGORITHMS:
        algorithm = policy_setup.make_algorithm(config, env, name)
        hyper = policy_setup.algorithm_hyper(config, name)
        state = jax.eval_shape(algorithm.init, key, hyper)
        yield Program(f"{name}: init", jax.jit(algorithm.init), (key, hyper))
        advance = functools.partial(training.chunk, algorithm, updates=20, evaluation=(task,))
        chunk = jax.jit(advance, donate_argnums=0)
        yield Program(f"{name}: chunk with evaluation", chunk, (state, hyper, reward))
        if name == "ppo":  # of another algorithm it is nearly the same
            begin = functools.partial(evaluate.begin, episodes=config.run.eval_episodes)
            begun = jax.eval_shape(functools.partial(begin, algorithm.episodes), key)
            args = algorithm, jax.eval_shape(algorithm.policy, state), reward, begun, key
            options = {"tau": hyper.tau, "deterministic": jnp.bool_(1)}
            yield Program("evaluate", evaluate.evaluate, args, options)


def _of_pretraining(config: RunConfig, env: Env) -> Iterator[Program]:
    """Programs of pretraining; they are compiled from shapes, without demonstrations."""
    static, hyper = setup.pretrain_config(config, len(env.classes)), setup.pretrain_hyper(config)
    objects = 2 + len(config.env.targets) + len(config.env.distractors)
    num, frames = config.demos.num, env.episode_length
    scene = jax.ShapeDtypeStruct((num, frames, objects, 2), jnp.float32)
    bits = jax.ShapeDtypeStruct((num, objects), jnp.bool_)
    label = jax.ShapeDtypeStruct((num, objects), jnp.int32)
    demos = DemoBatch(scene, scene, label, bits, bits, jax.ShapeDtypeStruct((num,), jnp.int32))
    key = jax.eval_shape(lambda: jax.random.key(0))
    init = key, demos, static
    yield Program("pretrain: init", pretrain.init, init, brief=True)
    step = jax.eval_shape(pretrain.init, *init), demos, hyper, static
    yield Program("pretrain: step", pretrain.step, step, brief=setup.few_updates(config))


def small_runs(options: list[str]) -> dict[str, Any]:
    """Times a small run of the whole pipeline with a cold cache, and again with a warm one."""
    runs = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in ("cold", "warm"):
            start = time.perf_counter()
            found = in_new_process(
                "from gril_jax.cli.main import main",
                f"main({['quickstart', '--out', f'{folder}/{name}', *options]!r}) and sys.exit(1)",
                "the small run", JAX_COMPILATION_CACHE_DIR=None, XDG_CACHE_HOME=folder,
            )  # fmt: skip
            taken = {"seconds": time.perf_counter() - start, "compile_s": found.compile_s}
            runs[name] = rounded(taken, 1) | {"programs": found.requests, "compiled": found.made}
    return runs
