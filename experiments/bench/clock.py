"""What the benchmarks measure with: compile times, calls in turn, counted compilations."""

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import jax
from jax.experimental.compilation_cache import compilation_cache

from gril_jax.compilation.compiler import compiled

__all__ = ["Compilations", "compile_timed", "counted", "times_in_turn", "without_cache"]


def compile_timed(function: Callable[..., Any], *args: Any, **options: Any) -> tuple[Any, float]:
    """A function compiled for these arguments, and the seconds it took with tracing."""
    start = time.perf_counter()
    program = compiled(jax.jit(function, **options).lower(*args))
    return program, time.perf_counter() - start


def times_in_turn(calls: Mapping[str, Callable[[], Any]], repeats: int) -> dict[str, list[float]]:
    """Seconds of `repeats` calls of each, which take turns after one call to warm up.

    They take turns so that a machine that is slow for a while is so for all of them.
    """
    taken: dict[str, list[float]] = {name: [] for name in calls}
    for number in range(repeats + 1):
        for name, call in calls.items():
            start = time.perf_counter()
            jax.block_until_ready(call())
            if number:
                taken[name].append(time.perf_counter() - start)
    return taken


class Compilations:
    """How many programs XLA was given, and how many of them came out of the persistent cache."""

    def __init__(self) -> None:
        self.requests = self.hits = 0
        self.seconds = 0.0

    @property
    def made(self) -> int:
        """Programs that XLA compiled."""
        return self.requests - self.hits

    def _on_duration(self, event: str, seconds: float, **_: Any) -> None:
        if event == "/jax/core/compile/backend_compile_duration":
            self.requests, self.seconds = self.requests + 1, self.seconds + seconds

    def _on_event(self, event: str, **_: Any) -> None:
        self.hits += event == "/jax/compilation_cache/cache_hits"


@contextlib.contextmanager
def counted() -> Iterator[Compilations]:
    """Counts the compilations of what runs inside."""
    count = Compilations()
    jax.monitoring.register_event_duration_secs_listener(count._on_duration)
    jax.monitoring.register_event_listener(count._on_event)
    try:
        yield count
    finally:
        jax.monitoring.unregister_event_duration_listener(count._on_duration)
        jax.monitoring.unregister_event_listener(count._on_event)


@contextlib.contextmanager
def without_cache() -> Iterator[None]:
    """Nothing is taken from the persistent cache, nor put there."""
    before = jax.config.jax_enable_compilation_cache
    jax.config.update("jax_enable_compilation_cache", False)
    compilation_cache.reset_cache()
    try:
        yield
    finally:
        jax.config.update("jax_enable_compilation_cache", before)
        compilation_cache.reset_cache()
