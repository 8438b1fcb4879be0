"""Seconds to trace and to compile each program of a run, and how many programs it has, as JSON.

    gril bench compile                  five minutes on 2 CPU cores

The programs are those of `gril quickstart`, compiled without the persistent cache and never run. A
small run of the whole pipeline then counts what XLA is given, once with an empty cache, as on a
new machine, and once more with what the first has left in it.
"""

import functools
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from gril_jax.experiments.pipeline import policy_setup, setup

from gril_jax.compilation.compiler import compiled
from gril_jax.config import RunConfig
from gril_jax.config.files import load
from gril_jax.config.tables import ALGORITHMS
from gril_jax.errors import RunError
from gril_jax.pretraining import pretrain
from gril_jax.rl import evaluate, training
from gril_jax.types import DemoBatch

from .clock import without_cache

__all__ = ["main", "programs", "small_runs", "timed"]


class Program(NamedTuple):
    """Something that a run compiles."""

    name: str
    function: Any  # jitted
    args: tuple[Any, ...]  # shapes will do
    options: dict[str, Any]  # static ones
    brief: bool = False  # see `gril_jax.compilation.compiler`


_SMALL = """--demos.num 6 --demos.num-validation 2 --demos.num-failures 2 --pretrain.steps 20
--pretrain.num-videos 4 --pretrain.num-frames 8 --encoder.width 16 --encoder.latent 8
--env.episode-length 90 --ppo.num-envs 16 --ppo.unroll-length 5 --ppo.num-timesteps 160
--ppo.hidden 16 --run.updates-per-chunk 1 --run.eval-episodes 4""".split()

_CHILD = """
import json, sys
from gril_jax.cli.heavy_imports import heavy_imports

with heavy_imports():
    from gril_jax.experiments.bench_clock import counted
from gril_jax import cli

with counted() as count:
    code = cli.main(json.loads(sys.argv[1]))
print()
print(json.dumps([code, count.requests, count.made, count.seconds]))
"""


def main(*, config: str, runs: bool, echo: Callable[[str], None]) -> None:
    """Echo the figures as JSON.

    Args:
      config: whose programs are compiled, by the name of a configuration.
      runs: whether to make the small runs as well.
      echo: takes the JSON.
    """
    result: dict[str, Any] = {"jax": jax.__version__, "config": config}
    if runs:  # before this process takes a GPU's memory
        result["small_run"] = small_runs(_SMALL)
    with without_cache():
        result["programs"] = {one.name: timed(one) for one in programs(load(config))}
    echo(json.dumps({"device": setup.device_in_words(), **result}, indent=2))


def timed(program: Program) -> dict[str, float]:
    """Seconds of tracing (into what XLA reads) and of XLA itself."""
    start = time.perf_counter()
    lowered = program.function.lower(*program.args, **program.options)
    traced = time.perf_counter()
    compiled(lowered, brief=program.brief)
    done = time.perf_counter()
    return {"trace_s": round(traced - start, 2), "compile_s": round(done - traced, 2)}


def programs(config: RunConfig) -> Iterator[Program]:
    """Those of a run of each algorithm."""
    env = setup.make_env(config.env, training=True)
    task = setup.make_env(config.env, training=False)
    yield from _of_pretraining(config, len(env.classes))
    reward = jax.eval_shape(lambda: setup.blank_reward(config, len(env.classes)))
    key = jax.eval_shape(lambda: jax.random.key(0))
    for name in ALGORITHMS:
        algorithm = policy_setup.make_algorithm(config, env, name)
        hyper = policy_setup.algorithm_hyper(config, name)
        state = jax.eval_shape(algorithm.init, key, hyper)
        yield Program(f"{name}: init", jax.jit(algorithm.init), (key, hyper), {})
        chunk = _chunk(algorithm, task)
        yield Program(f"{name}: chunk with evaluation", chunk, (state, hyper, reward), {})
        policy = jax.eval_shape(algorithm.policy, state)
        options = {"tau": hyper.tau, "episodes": config.run.eval_episodes}
        if name == "ppo":  # of another algorithm it is nearly the same
            args, drawn = (algorithm, policy, reward, key), {"deterministic": jnp.bool_(1)}
            yield Program("evaluate", evaluate.evaluate, args, options | drawn)


def _of_pretraining(config: RunConfig, classes: int) -> Iterator[Program]:
    """Programs are compiled for shapes, so demonstrations of zeros will do."""
    static, hyper = setup.pretrain_config(config, classes), setup.pretrain_hyper(config)
    objects = 2 + len(config.env.targets) + len(config.env.distractors)
    num, frames = config.demos.num, config.env.episode_length
    scene = jax.ShapeDtypeStruct((num, frames, objects, 2), jnp.float32)
    bits = jax.ShapeDtypeStruct((num, objects), jnp.bool_)
    label = jax.ShapeDtypeStruct((num, objects), jnp.int32)
    demos = DemoBatch(scene, scene, label, bits, bits, jax.ShapeDtypeStruct((num,), jnp.int32))
    key = jax.eval_shape(lambda: jax.random.key(0))
    init = key, demos, static
    yield Program("pretrain: init", pretrain.init, init, {}, brief=True)
    step = jax.eval_shape(pretrain.init, *init), demos, hyper, static
    yield Program("pretrain: step", pretrain.step, step, {}, brief=setup.few_updates(config))


def _chunk(algorithm: training.Algorithm, task: Any) -> Any:
    advance = functools.partial(training.chunk, algorithm, updates=20, evaluation=(task,))
    return jax.jit(advance, donate_argnums=0)


def small_runs(options: list[str]) -> dict[str, Any]:
    """The same run of the whole pipeline with an empty cache, and with a full one."""
    with tempfile.TemporaryDirectory() as folder:
        return {name: _run(Path(folder), name, options) for name in ("cold", "warm")}


def _run(folder: Path, name: str, options: list[str]) -> dict[str, Any]:
    surroundings = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
    surroundings |= {"XDG_CACHE_HOME": str(folder), "XLA_PYTHON_CLIENT_PREALLOCATE": "false"}
    args = json.dumps(["quickstart", "--out", str(folder / name), *options])
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", _CHILD, args],
        capture_output=True, text=True, env=surroundings, check=False,
    )  # fmt: skip
    seconds = time.perf_counter() - start
    code, requests, made, compile_s = (
        (done.returncode, 0, 0, 0.0)
        if done.returncode
        else json.loads(done.stdout.splitlines()[-1])
    )
    if code:
        raise RunError(f"the small run failed: {(done.stderr.strip() or 'in silence')[-300:]}")
    return {
        "seconds": round(seconds, 1),
        "programs": requests,
        "compiled": made,
        "compile_s": round(compile_s, 1),
    }
