"""Temporal cycle-consistency, value and gradient, beside a loop over pairs.

The peer is XIRL's published structure in JAX: a Python loop over the ordered pairs of videos that
collects the logits of all, and one regression over them. On 2 CPU cores it takes about a minute,
most of it the compilation of the loop.
"""

import functools
import statistics
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from gril_jax.losses import mean_cycle_consistency

from .frame import median_ms, staged, times_in_turn, without_cache

_SIZE = (8, 32, 32)  # videos, frames, width of the latent
_COMPILATIONS = 3  # of each, whose median counts


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


def measure(repeats: int) -> dict[str, Any]:
    """Times, memory and the loop's over the others'; a ratio above 1 favours the library."""
    at_once = functools.partial(mean_cycle_consistency, at_once=True)
    losses = {"pair_loop": pair_loop, "mapped": mean_cycle_consistency, "at_once": at_once}
    num_videos, num_frames, width = _SIZE
    times = jnp.tile(jnp.arange(num_frames) / num_frames, (num_videos, 1))
    args = jax.random.normal(jax.random.key(0), _SIZE), times
    compiled, taken = {}, {name: [] for name in losses}
    for _ in range(_COMPILATIONS):
        for name, loss in losses.items():
            # A new function each time: one that has been traced before is not traced again.
            fresh = jax.jit(jax.value_and_grad(functools.partial(loss)))
            with without_cache():
                compiled[name], *seconds = staged(fresh, args, plain=True)
            taken[name].append(seconds)
    calls = {name: functools.partial(program, *args) for name, program in compiled.items()}
    run_ms = median_ms(times_in_turn(calls, repeats))
    figures = {}
    for name, program in compiled.items():
        trace_s, compile_s = (statistics.median(x) for x in zip(*taken[name], strict=True))
        figures[name] = {
            "run_ms": run_ms[name],
            "trace_s": round(trace_s, 3),
            "compile_s": round(compile_s, 3),
            "temporary_mb": round(program.memory_analysis().temp_size_in_bytes / 1e6, 3),
        }
    peer = figures["pair_loop"]
    over = {
        f"pair_loop_over_{name}": {key: round(peer[key] / own[key], 2) for key in peer}
        for name, own in figures.items()
        if own is not peer
    }
    for name, program in compiled.items():
        figures[name]["value"] = float(program(*args)[0])
    return {"videos": num_videos, "frames": num_frames, "width": width, **figures, **over}
