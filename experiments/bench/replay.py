"""The replay beside brax's queue, alone and with seeds side by side.

    gril bench replay                   half a minute on 2 CPU cores

One step inserts 64 rows into a replay of 200,000 and samples 256, as in training: in a donated
scan. Times are medians in milliseconds of a step. Once full brax's `UniformSamplingQueue` rolls its
whole buffer in every step; under a vmap it does so from the start, since its `lax.cond` becomes a
choice between the buffer and a rolled copy of it.
"""

from typing import Any

import jax
import jax.numpy as jnp
from brax.training.replay_buffers import UniformSamplingQueue

from gril_jax.rl import replay

from .frame import InPlace, median_ms, ratios, rounded

_CAPACITY, _ROWS, _BATCH, _WIDTH = 200_000, 64, 256, 64
_REPEATS = 7  # timed calls of each form
_CASES = ((1, False), (1, True), (8, False), (8, True))  # seeds, full


def main() -> dict[str, Any]:
    """The times of each case."""
    sizes = {"capacity": _CAPACITY, "inserted": _ROWS, "sampled": _BATCH, "numbers_a_row": _WIDTH}
    return sizes | {"replay": [measure(n, _REPEATS, full=full) for n, full in _CASES]}


def measure(seeds: int, repeats: int, *, full: bool, capacity: int = _CAPACITY) -> dict[str, Any]:
    """Milliseconds of a step, ours and brax's; replays that are not full are nearly empty."""
    steps = {"ours": 200, "brax": 2 if full or seeds > 1 else 200}  # 2 where all is copied
    forms = {"ours": _ours(capacity, full), "brax": _brax(capacity, full)}
    calls = {name: _moved(*form, seeds, steps[name]) for name, form in forms.items()}
    times = {name: ms / steps[name] for name, ms in median_ms(calls, repeats).items()}
    case = {"seeds": seeds, "full": full, "ms": rounded(times, 4)}
    return case | {"times_as_slow": ratios(times, "ours")}


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


def _moved(init, step, seeds, steps) -> InPlace:
    """A replay that each call moves on by some steps."""

    def run(carry):
        def move(state, number):
            state, batch = step(state, jnp.full((_ROWS, _WIDTH), number, jnp.float32))
            return state, batch.sum()

        return jax.lax.scan(move, carry[0], jnp.arange(steps))

    key = jax.random.key(0)
    if seeds > 1:
        init, run, key = jax.vmap(init), jax.vmap(run), jax.random.split(key, seeds)
    state = jax.jit(init)(key)
    return InPlace(run, (state, jnp.zeros((seeds, steps) if seeds > 1 else steps)))
