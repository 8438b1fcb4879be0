"""Temporal cycle-consistency, value and gradient, beside a loop over pairs.

The peer is XIRL's published structure in JAX: a Python loop over the ordered pairs of videos that
collects the logits of all, and one regression over them. On 2 CPU cores it takes about a minute,
most of it the compilation of the loop.
"""

import functools
import statistics
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from gril_jax.losses import mean_cycle_consistency

from .frame import median_ms, staged, times_in_turn, without_cache

__all__ = ["measure", "pair_loop"]

# Videos, frames, width of the latent. The loop is for the first alone: 992 pairs do not compile
# in any useful time.
_SMALL, _LARGE = (8, 32, 32), (32, 64, 32)


def pair_loop(latents: Float[Array, "B T D"], times: Float[Array, "B T"]) -> Float[Array, ""]:
    """The same loss, looping over pairs of videos, as in the published code."""
    num_videos, num_frames, width = latents.shape

    def similarity(a, b):
        squares = jnp.sum(a * a, axis=1)[:, None] + jnp.sum(b * b, axis=1)
        return (2.0 * a @ b.T - squares) / width

    logits, steps = [], []
    pairs = [(i, j) for i in range(num_videos) for j in range(num_videos) if i != j]
    for i, j in pairs:
        weights = jax.nn.softmax(similarity(latents[i], latents[j]), axis=1)
        logits.append(similarity(weights @ latents[j], latents[i]))
        steps.append(jnp.broadcast_to(times[i], (num_frames, num_frames)))
    weights = jax.nn.softmax(jnp.concatenate(logits), axis=1)
    steps = jnp.concatenate(steps)
    home = jax.nn.one_hot(jnp.tile(jnp.arange(num_frames), len(pairs)), num_frames)
    error = jnp.sum(steps * weights, axis=1) - jnp.sum(steps * home, axis=1)
    return jnp.mean(jnp.square(error))


def measure(compile_repeats: int = 3, repeats: int = 30) -> dict[str, Any]:
    """Times, memory and ratios at both sizes; a ratio above 1 favours the library."""
    at_once = functools.partial(mean_cycle_consistency, at_once=True)
    small = {"pair_loop": pair_loop, "mapped": mean_cycle_consistency, "at_once": at_once}
    large = {"at_once": at_once, "mapped": mean_cycle_consistency}
    return {
        "tcc_8_32_32": _compare(small, _SMALL, compile_repeats, repeats),
        "tcc_32_64_32": _compare(large, _LARGE, 1, repeats),
    }


def _compare(losses: dict[str, Callable], size, compile_repeats, repeats) -> dict[str, Any]:
    """The figures of each loss, and those of the first over the others'."""
    num_videos, num_frames, width = size
    times = jnp.tile(jnp.arange(num_frames) / num_frames, (num_videos, 1))
    args = jax.random.normal(jax.random.key(0), size), times
    compiled, taken = {}, {name: [] for name in losses}
    for _ in range(compile_repeats):
        for name, loss in losses.items():
            # A new function each time: one that has been traced before is not traced again.
            fresh = jax.jit(jax.value_and_grad(functools.partial(loss)))
            with without_cache():
                compiled[name], *seconds = staged(fresh, args, plain=True)
            taken[name].append(seconds)
    calls = {name: functools.partial(program, *args) for name, program in compiled.items()}
    run_ms = median_ms(times_in_turn(calls, repeats))
    figures = {
        name: {
            "run_ms": run_ms[name],
            "trace_s": round(statistics.median(trace for trace, _ in taken[name]), 3),
            "compile_s": round(statistics.median(compiling for _, compiling in taken[name]), 3),
            "temporary_mb": round(program.memory_analysis().temp_size_in_bytes / 1e6, 3),
            "value": float(program(*args)[0]),
        }
        for name, program in compiled.items()
    }
    peer, *others = figures
    keys = ("run_ms", "trace_s", "compile_s", "temporary_mb")
    over = {
        f"{peer}_over_{name}": {k: round(figures[peer][k] / figures[name][k], 2) for k in keys}
        for name in others
    }
    return {"videos": num_videos, "frames": num_frames, "width": width, **figures, **over}
