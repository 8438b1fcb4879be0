"""Temporal cycle-consistency: value and gradient, beside a loop over pairs, as a dict for JSON.

The peer is XIRL's published structure in JAX: a Python loop over the ordered pairs of videos that
collects the logits of all, and one regression over them. Both are jitted. Compilations and runs
of the sides take turns; figures are medians. On 2 CPU cores it takes about a minute, most of it
the compilation of the loop.
"""

import functools
import statistics
import time
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from gril_jax.losses import mean_cycle_consistency

from .clock import without_cache

__all__ = ["measure", "pair_loop"]

# Videos, frames, width of the latent. The loop is for the first alone: 992 pairs do not compile
# in any useful time.
_SMALL = (8, 32, 32)
_LARGE = (32, 64, 32)


def pair_loop(latents: Float[Array, "B T D"], times: Float[Array, "B T"]) -> Float[Array, ""]:
    """The same loss, one pair of videos after the other, as the published code has it."""
    num_videos, num_frames, width = latents.shape

    def similarity(a, b):
        squares = jnp.sum(a * a, axis=1)[:, None] + jnp.sum(b * b, axis=1)
        return (2.0 * a @ b.T - squares) / width

    logits, labels, steps = [], [], []
    for i in range(num_videos):
        for j in range(num_videos):
            if i != j:
                weights = jax.nn.softmax(similarity(latents[i], latents[j]), axis=1)
                logits.append(similarity(weights @ latents[j], latents[i]))
                labels.append(jnp.arange(num_frames))
                steps.append(jnp.broadcast_to(times[i], (num_frames, num_frames)))
    weights = jax.nn.softmax(jnp.concatenate(logits), axis=1)
    steps = jnp.concatenate(steps)
    home = jax.nn.one_hot(jnp.concatenate(labels), num_frames)
    error = jnp.sum(steps * weights, axis=1) - jnp.sum(steps * home, axis=1)
    return jnp.mean(jnp.square(error))


def measure(compile_repeats: int = 3, repeats: int = 30) -> dict:
    """Times, memory and ratios at both sizes; a ratio above 1 is in favour of the library."""
    at_once = functools.partial(mean_cycle_consistency, at_once=True)
    small = _compare(
        {"pair_loop": pair_loop, "mapped": mean_cycle_consistency, "at_once": at_once},
        _SMALL,
        compile_repeats,
        repeats,
    )
    large = _compare({"at_once": at_once, "mapped": mean_cycle_consistency}, _LARGE, 1, repeats)
    return {"tcc_8_32_32": small, "tcc_32_64_32": large}


def _compare(losses: dict[str, Callable], size, compile_repeats, repeats) -> dict:
    """The first loss is the peer of the others."""
    num_videos, num_frames, width = size
    latents = jax.random.normal(jax.random.key(0), size)
    times = jnp.tile(jnp.arange(num_frames) / num_frames, (num_videos, 1))
    trace_s: dict[str, list] = {name: [] for name in losses}
    compile_s: dict[str, list] = {name: [] for name in losses}
    run_ms: dict[str, list] = {name: [] for name in losses}
    compiled = {}
    for _ in range(compile_repeats):
        for name, loss in losses.items():
            # A new function each time: one that has been traced before is not traced again.
            fresh = jax.jit(jax.value_and_grad(functools.partial(loss)))
            start = time.perf_counter()
            lowered = fresh.lower(latents, times)
            trace_s[name].append(time.perf_counter() - start)
            start = time.perf_counter()
            with without_cache():
                compiled[name] = lowered.compile()
            compile_s[name].append(time.perf_counter() - start)
    values = {name: run(latents, times)[0] for name, run in compiled.items()}
    for _ in range(repeats):
        for name, run in compiled.items():
            start = time.perf_counter()
            jax.block_until_ready(run(latents, times))
            run_ms[name].append(1e3 * (time.perf_counter() - start))
    figures = {
        name: {
            "run_ms": round(statistics.median(run_ms[name]), 3),
            "trace_s": round(statistics.median(trace_s[name]), 3),
            "compile_s": round(statistics.median(compile_s[name]), 3),
            "temporary_mb": round(run.memory_analysis().temp_size_in_bytes / 1e6, 3),
            "value": float(values[name]),
        }
        for name, run in compiled.items()
    }
    peer, *others = figures
    ratios = {
        f"{peer}_over_{name}": {
            key: round(figures[peer][key] / figures[name][key], 2)
            for key in ("run_ms", "trace_s", "compile_s", "temporary_mb")
        }
        for name in others
    }
    return {"videos": num_videos, "frames": num_frames, "width": width, **figures, **ratios}
