"""The frame of all benchmarks: the machine, calls in turn, ratios, compilations, new processes.

The `main` of a benchmark takes its options and returns the figures of its sides; `gril bench`
prints them with `machine` as JSON.
"""

import contextlib
import dataclasses
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import jax
from jax.experimental.compilation_cache import compilation_cache

from gril_jax.compilation.compiler import compiled
from gril_jax.errors import RunError
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


@dataclasses.dataclass
class Compilations:
    """Counts of the programs given to XLA, and of those found in the persistent cache."""

    requests: int = 0
    hits: int = 0
    seconds: float = 0.0

    @property
    def made(self) -> int:
        """Number of programs that XLA compiled."""
        return self.requests - self.hits

    def _on_duration(self, event: str, seconds: float, **_: Any) -> None:
        if event == "/jax/core/compile/backend_compile_duration":
            self.requests, self.seconds = self.requests + 1, self.seconds + seconds

    def _on_event(self, event: str, **_: Any) -> None:
        self.hits += event == "/jax/compilation_cache/cache_hits"


@contextlib.contextmanager
def counted() -> Iterator[Compilations]:
    """Counts the compilations inside a `with` block."""
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
    """Disables the persistent cache inside a `with` block."""
    before = jax.config.jax_enable_compilation_cache
    jax.config.update("jax_enable_compilation_cache", False)
    compilation_cache.reset_cache()
    try:
        yield
    finally:
        jax.config.update("jax_enable_compilation_cache", before)
        compilation_cache.reset_cache()


_CHILD = """
import json, sys
from gril_jax.cli.heavy_imports import heavy_imports

with heavy_imports():
    from gril_jax.experiments.bench.frame import counted
    {imports}
with counted() as count:
    answer = {call}
print()
print(json.dumps([answer, count.requests, count.made, count.seconds]))
"""


class Answer(NamedTuple):
    """Result of a call in a process of its own, and what XLA compiled for it."""

    value: Any  # as JSON has it
    requests: int  # programs given to XLA
    made: int  # those that it compiled
    compile_s: float


def in_new_process(imports: str, call: str, whose: str, **environment: str | None) -> Answer:
    """A call, as Python code, in a process of its own, which takes no GPU memory beforehand.

    A variable of the environment that is None is left out; `whose` names the work in the error.
    """
    variables = {**os.environ, "XLA_PYTHON_CLIENT_PREALLOCATE": "false", **environment}
    done = subprocess.run(
        [sys.executable, "-c", _CHILD.format(imports=imports, call=call)],
        capture_output=True, text=True,
        env={name: value for name, value in variables.items() if value is not None},
    )  # fmt: skip
    if done.returncode:
        reason = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise RunError(f"{whose} failed: {reason}")
    return Answer(*json.loads(done.stdout.splitlines()[-1]))
