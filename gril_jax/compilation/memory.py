"""Predicts the memory of a training program before it is compiled, and reads how much there is.

The estimate counts arrays that are surely in memory at once:

- the state, twice while it is replaced; a replay once, as it is written in place;
- the data of an unroll, as collected, in brax's order, and shuffled;
- what the networks of one minibatch keep for their gradients;
- what a simulator holds during one control step of all environments, or the reward's own arrays,
  if these are larger.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from jax.extend.core import jaxprs_in_params

from gril_jax.errors import ConfigError
from gril_jax.rl.training import Algorithm

_COPIES = 3  # of the collected data
# Peak of one control step, as a multiple of the task's physics state: 222 on MatchRegions with five
# blocks on a CPU, but the data of an unroll, counted below, are not there at the same time.
_STEP_COPIES = 180
# Arrays of the size of its largest one that a reward holds at once, of all environments: a layer's
# input, its output, and what the output becomes before the next layer.
_REWARD_ARRAYS = 3
# What a GPU's program may take, as a multiple of the prediction, whose arrays are sure to be there:
# 25 policies of MatchRegions took 85 GiB where 30 were predicted (H100, JAX 0.11).
_GPU_MARGIN = 3


def predict_bytes(algorithm: Algorithm, hyper: Any, reward_params: Any) -> int:
    """Bytes that one seed needs while it trains, from shapes alone."""
    key = jax.random.key(0)
    state = jax.eval_shape(algorithm.init, key, hyper)
    exploring = jax.ShapeDtypeStruct((algorithm.num_envs,), jnp.bool_)

    def collect(state, hyper, reward_params, exploring):
        return algorithm.collect(state, state.key, hyper, reward_params, deterministic=exploring)[1]

    steps = jax.eval_shape(collect, state, hyper, reward_params, exploring)
    static = algorithm.static
    batch = getattr(static, "batch_size", 0) or (
        static.num_envs * static.unroll_length // static.num_minibatches
    )
    layers = 2 * 3 * sum(static.hidden)  # two networks; values, gradients and activations
    physics = _bytes(state.envs.running.state.data)
    seen = _REWARD_ARRAYS * algorithm.num_envs * _largest(algorithm, state, reward_params)
    return (
        2 * _bytes(state)
        - _bytes(state.replay)
        + _COPIES * _bytes(steps)
        + _bytes(reward_params)
        + 4 * layers * batch
        + max(_STEP_COPIES * physics, seen)  # the simulator is done when the reward begins
    )


def available_bytes(device: Any) -> int | None:
    """Bytes of a device of this process that a program may use; None if the platform does not tell.

    Several CPU devices, as `--xla_force_host_platform_device_count` makes them, share evenly.
    """
    if device.platform == "cpu":
        try:
            lines = Path("/proc/meminfo").read_text().splitlines()
        except OSError:
            return None
        kilobytes = next(int(x.split()[1]) for x in lines if x.startswith("MemAvailable"))
        return 1024 * kilobytes // device.client.local_device_count()
    return (device.memory_stats() or {}).get("bytes_limit")


def margin() -> int:
    """Bytes that a program may take on JAX's default devices, as a multiple of the prediction."""
    return _GPU_MARGIN if jax.default_backend() == "gpu" else 1


def split(
    rows: int, bytes_each: int, available: int | None, devices: int = 1, margin: int = 1
) -> int:
    """The number of seeds to run at once, such that they fit: a multiple of `devices` if possible.

    `rows` are the seeds in all, which need `bytes_each`, and `available` the bytes of one device;
    where they are not known, all run at once. One seed runs if it fits; several have to fit
    `margin` times.

    Raises:
      ConfigError: not even one seed fits into the memory of all devices together.
    """
    if available is None:
        return rows
    fit = available * devices // bytes_each
    if not fit:
        raise ConfigError(
            f"one seed needs about {bytes_each / 2**30:.1f} GiB but there are "
            f"{available * devices / 2**30:.1f} GiB: lower num_envs or unroll_length, and "
            "encoder.pixels where encoder.kind is 'pixels'"
        )
    fit = max(1, fit // margin)
    parts = math.ceil(rows / min(rows, fit))
    each = math.ceil(rows / parts)
    rounded = math.ceil(each / devices) * devices
    return rounded if rounded <= fit else each


def _largest(algorithm: Algorithm, state: Any, reward_params: Any) -> int:
    """Bytes per environment of the largest array that the reward makes.

    What does not grow with their number, such as weights in another precision, is there once.
    """
    running = state.envs.running
    seen = running.reward_memory, running.state, running.memory.active
    pay = jax.vmap(algorithm.episodes.reward.step, (None, 0, 0, 0))

    def sizes(count):
        some = jax.tree.map(lambda x: jax.ShapeDtypeStruct((count, *x.shape[1:]), x.dtype), seen)
        return [_bytes(x.aval) for x in _made(jax.make_jaxpr(pay)(reward_params, *some).jaxpr)]

    return max((b - a for a, b in zip(sizes(2), sizes(3), strict=True)), default=0)


def _made(program: Any) -> Iterator[Any]:
    """All intermediate values of a jaxpr and its inner jaxprs."""
    for equation in program.eqns:
        yield from equation.outvars
        for inner in jaxprs_in_params(equation.params):
            yield from _made(inner)


def _bytes(tree: Any) -> int:
    return sum(math.prod(x.shape) * max(x.dtype.itemsize, 1) for x in jax.tree.leaves(tree))
