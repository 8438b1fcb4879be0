"""The frame of all benchmarks: the machine, calls in turn, ratios.

The `main` of a benchmark takes its options and returns the figures of its sides; `gril bench`
prints them with `machine` as JSON.
"""

import contextlib
import statistics
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import jax
from jax.experimental.compilation_cache import compilation_cache

from gril_jax.compilation.compiler import compiled
from gril_jax.workflows.build import setup

Calls = Mapping[str, Callable[[], Any]]  # by the side that each is of


def machine() -> dict[str, Any]:
    """The devices and JAX's version."""
    return {"device": setup.device_in_words(), "jax": jax.__version__}


def compile_timed(function: Callable, *args: Any, plain: bool = False, **options: Any):
    """A function compiled for these arguments, and the seconds, tracing included."""
    program, trace_s, compile_s = staged(jax.jit(function, **options), args, plain=plain)
    return program, trace_s + compile_s


def staged(
    function: Any, args: tuple[Any, ...], *, plain: bool = False, brief: bool = False, **static: Any
) -> tuple[Any, float, float]:
    """A jitted function compiled, the seconds of tracing it, and those of XLA itself.

    `plain` compiles as JAX does by itself; `brief` is that of `gril_jax.compilation.compiler`.
    """
    start = time.perf_counter()
    lowered = function.lower(*args, **static)
    traced = time.perf_counter()
    program = lowered.compile() if plain else compiled(lowered, brief=brief)
    return program, traced - start, time.perf_counter() - traced


class InPlace:
    """A compiled program that advances its state at each call, in place."""

    def __init__(self, run: Callable[[Any], Any], state: Any):
        self._run, _ = compile_timed(run, state, donate_argnums=0)
        self._state = state

    def __call__(self) -> Any:
        self._state = self._run(self._state)
        return self._state


def times_in_turn(calls: Calls, repeats: int, *, pause_s: float = 0.0) -> dict[str, list[float]]:
    """Seconds of `repeats` calls of each, interleaved, after one warm-up call.

    A machine that is slow for a while is so for all. A pause lets the last one's threads stop.
    """
    taken: dict[str, list[float]] = {name: [] for name in calls}
    for number in range(repeats + 1):
        for name, call in calls.items():
            time.sleep(pause_s)
            start = time.perf_counter()
            jax.block_until_ready(call())
            if number:
                taken[name].append(time.perf_counter() - start)
    return taken


def speeds(calls: Calls, steps: Mapping[str, int], repeats: int) -> dict[str, float]:
    """Steps a second of the fastest call of each, of which one has so many steps."""
    taken = times_in_turn(calls, repeats)
    return {name: steps[name] / min(times) for name, times in taken.items()}


def median_ms(calls: Calls, repeats: int, *, pause_s: float = 0.0) -> dict[str, float]:
    """The median time of each, in milliseconds."""
    taken = times_in_turn(calls, repeats, pause_s=pause_s)
    return {name: round(1e3 * statistics.median(times), 3) for name, times in taken.items()}


def ratios(values: Mapping[str, int | float], peer: str) -> dict[str, float]:
    """Each value as a multiple of that of the peer."""
    return {name: round(value / values[peer], 2) for name, value in values.items()}


def rounded(values: Mapping[str, int | float], digits: int = 2) -> dict[str, int | float]:
    """Each value with so many digits after the point; with 0, whole numbers."""
    return {name: round(value, digits or None) for name, value in values.items()}


@contextlib.contextmanager
def without_cache() -> Iterator[None]:
    """Disables the persistent cache inside a `with` block."""
    before = jax.config.jax_enable_compilation_cache
    jax.config.update("jax_enable_compilation_cache", False)
    compilation_cache.reset_cache()
    try:
        yield
    finally:
        jax.config.update("jax_enable_compilation_cache", before)
        compilation_cache.reset_cache()
