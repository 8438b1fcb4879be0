"""The replay beside brax's queue, alone and with seeds side by side, as JSON.

    gril bench replay                   half a minute on 2 CPU cores

One step inserts 64 rows into a replay of 200,000 and samples 256, as both are used in training: in
a donated scan. Times are medians in milliseconds of a step, of programs that take turns; a ratio
says how many times longer brax's `UniformSamplingQueue` takes. Once full it rolls its whole buffer
in every step. Under a vmap it does so from the start: its `lax.cond` becomes a choice between the
buffer and a rolled copy of it.
"""

import json
import statistics
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from brax.training.replay_buffers import UniformSamplingQueue
from gril_jax.experiments.pipeline import setup

from gril_jax.rl import replay

__all__ = ["main", "measure"]

_CAPACITY, _ROWS, _BATCH, _WIDTH = 200_000, 64, 256, 64
_CASES = ((1, False), (1, True), (8, False), (8, True))  # seeds, full


def main(repeats: int, *, echo: Callable[[str], None]) -> None:
    """Echo the times of each case as JSON."""
    result: dict[str, Any] = {
        "device": setup.device_in_words(), "jax": jax.__version__, "capacity": _CAPACITY,
        "inserted": _ROWS, "sampled": _BATCH, "numbers_a_row": _WIDTH,
    }  # fmt: skip
    result["replay"] = [measure(seeds, repeats, full=full) for seeds, full in _CASES]
    echo(json.dumps(result, indent=2))


def measure(seeds: int, repeats: int, *, full: bool, capacity: int = _CAPACITY) -> dict[str, Any]:
    """Milliseconds of a step with this many seeds, ours and brax's.

    Args:
      seeds: 1 is without a vmap.
      repeats: timed calls of each form, whose median counts.
      full: whether the replays are full, or nearly empty.
      capacity: rows of each seed's replay.
    """
    steps = {"ours": 200, "brax": 2 if full or seeds > 1 else 200}  # 2 where all is copied
    forms = {"ours": _ours(capacity, full), "brax": _brax(capacity, full)}
    calls = {name: _Call(*form, seeds, steps[name]) for name, form in forms.items()}
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for number in range(repeats + 1):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            if number:  # the first compiles
                seconds[name].append(time.perf_counter() - start)
    times = {n: 1e3 * statistics.median(taken) / steps[n] for n, taken in seconds.items()}
    return {
        "seeds": seeds,
        "full": full,
        "ms": {name: round(value, 4) for name, value in times.items()},
        "times_as_slow": {name: round(value / times["ours"], 2) for name, value in times.items()},
    }


def _ours(capacity, full):
    def init(key):
        ring = replay.init(jnp.zeros(_WIDTH), capacity - capacity % _ROWS)
        return ring._replace(size=jnp.where(full, ring.rows.shape[0], 0)), key

    def step(state, rows):
        ring, key = state
        key, key_sample = jax.random.split(key)
        ring = replay.insert(ring, rows)
        return (ring, key), replay.sample(ring, key_sample, _BATCH)

    return init, step


def _brax(capacity, full):
    queue = UniformSamplingQueue(capacity, jnp.zeros(_WIDTH), _BATCH)

    def init(key):
        begun = queue.init(key)
        return begun.replace(insert_position=jnp.where(full, capacity, _ROWS))

    def step(state, rows):
        return queue.sample_internal(queue.insert_internal(state, rows))

    return init, step


class _Call:
    """A replay that each call moves on by some steps, in place."""

    def __init__(self, init, step, seeds, steps):
        def run(state):
            def move(state, number):
                state, batch = step(state, jnp.full((_ROWS, _WIDTH), number, jnp.float32))
                return state, batch.sum()

            return jax.lax.scan(move, state, jnp.arange(steps))

        key = jax.random.key(0)
        if seeds > 1:
            init, run, key = jax.vmap(init), jax.vmap(run), jax.random.split(key, seeds)
        self._run = jax.jit(run, donate_argnums=0)
        self._state = jax.jit(init)(key)

    def __call__(self):
        self._state, sums = self._run(self._state)
        jax.block_until_ready((self._state, sums))
