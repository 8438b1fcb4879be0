"""Soft-DTW, both recursions, as one kernel for CUDA GPUs (Pallas on Triton).

As compiled loops (`soft_dtw_wavefront`, its oracle and fallback) an anti-diagonal costs several
kernel launches, some 10 microseconds; there are 2 (T + S - 1) of them. Here one program takes one
pair through all of them. Each row of the cost is a lane, which keeps its own last sums in
registers; it needs its upper neighbour's, and since Pallas offers no exchange between threads,
the lanes write them to a small buffer that stays in cache, with one barrier per anti-diagonal and
two slots in turn. The alternative, pairs as lanes, needs no exchange but takes T x S steps in
sequence where this takes T + S - 1.

The weights are stored by (step mod S, row): a row is inside of the matrix for S steps in a row,
so each place is used once, neighbouring lanes write neighbouring places, and nothing is wasted on
the half of the anti-diagonals that lies outside.

This module is imported by `soft_dtw` alone, and only where a GPU is.
"""

import functools

import jax
import jax.numpy as jnp
from jax.experimental import pallas as pl
from jax.experimental.pallas import triton as plgpu
from jaxtyping import Array, Float, Int

from .soft_dtw_wavefront import FORBIDDEN, soft_minimum

__all__ = ["kernel"]


def kernel(
    cost: Float[Array, "B T S"],
    gamma: Float[Array, "B"],
    rows: Int[Array, "B"],
    columns: Int[Array, "B"],
    *,
    alignment: bool = True,
    interpret: bool = False,
) -> tuple[Float[Array, "B"], Float[Array, "B T S"] | None]:
    """What `soft_dtw_wavefront.recursion` gives, in float32; `interpret` runs it on any device."""
    num_pairs, num_rows, num_columns = cost.shape
    lanes = max(32, pl.next_power_of_2(num_rows))
    pair = jax.ShapeDtypeStruct((num_pairs,), jnp.float32)
    exchange = jax.ShapeDtypeStruct((num_pairs, 2, 2, lanes + 1), jnp.float32)
    flow = jax.ShapeDtypeStruct((num_pairs, lanes, num_columns), jnp.float32)
    weights = jax.ShapeDtypeStruct((num_pairs, 2, num_columns, lanes), jnp.float32)
    run = pl.pallas_call(
        functools.partial(_program, shape=cost.shape[1:], lanes=lanes, barrier=not interpret),
        out_shape=(pair, exchange, *((flow, weights) if alignment else ())),
        grid=(num_pairs,),
        interpret=interpret,
        compiler_params=plgpu.CompilerParams(num_warps=min(8, lanes // 32), num_stages=1),
        name="soft_dtw",
    )
    value, _, *rest = run(cost, gamma, rows, columns)
    return value, rest[0][:, :num_rows] if alignment else None


def _program(cost, gamma, rows, columns, value, exchange, *rest, shape, lanes, barrier):
    """One pair: sums from the first anti-diagonal to the last, then the flow back."""
    num_rows, num_columns = shape
    pair = pl.program_id(0)
    row = jnp.arange(lanes)
    end_row, end_column = rows[pair] - 1, columns[pair] - 1
    # The step at which a lane holds the cell where the path ends; -1 is never.
    end = jnp.where(row == end_row, end_column + row, -1)
    steps = num_rows + num_columns - 1

    def inside(step):
        return (row < num_rows) & (step >= row) & (step - row < num_columns)

    def cell(step):
        """Columns of the lanes' cells, in range also for lanes that are outside."""
        return jnp.clip(step - row, 0, num_columns - 1)

    def wait():
        if barrier:
            plgpu.debug_barrier()

    def read(slot, part, shift):
        return plgpu.load(exchange.at[pair, slot, part, row + shift], volatile=True)

    def write(slot, part, shift, x):
        plgpu.store(exchange.at[pair, slot, part, row + shift], x)

    def costs(step):
        place = cost.at[pair, jnp.minimum(row, num_rows - 1), cell(step)]
        return plgpu.load(place, mask=inside(step), other=FORBIDDEN)

    edge = jnp.full((lanes,), FORBIDDEN, jnp.float32)
    none = jnp.zeros((lanes,), jnp.float32)
    softness = gamma[pair]

    # Place r + 1 of the buffer holds row r, place 0 the row above the first, always forbidden.
    for slot in (0, 1):
        for part, x in ((0, edge), (1, none)):
            write(slot, part, 0, x)
    wait()
    for slot in (0, 1):
        for part, x in ((0, edge), (1, none)):
            write(slot, part, 1, x)
    wait()

    def forth(step, carry):
        ended, left, diagonal, here = carry
        later = costs(step + 1)  # asked for before the barrier, needed after it
        up = tuple(read(jax.lax.rem(step + 1, 2), part, 0) for part in (0, 1))
        sums, weights = soft_minimum(softness, up, left, diagonal, here)
        ended = jnp.where(end == step, sums[0] + sums[1], ended)
        for part in (0, 1):
            write(jax.lax.rem(step, 2), part, 1, sums[part])
        if rest:
            for which in (0, 1):
                place = rest[1].at[pair, which, jax.lax.rem(step, num_columns), row]
                plgpu.store(place, weights[which], mask=inside(step))
        wait()
        return ended, sums, up, later

    corner = jnp.where(row == 0, 0.0, edge)
    init = none, (edge, none), (corner, none), costs(0)
    ended, *_ = jax.lax.fori_loop(0, steps, forth, init)
    value[pair] = jnp.sum(ended)
    if not rest:
        return
    flow, stored = rest

    def weights_at(step):
        step = jnp.maximum(step, 0)
        places = (stored.at[pair, which, jax.lax.rem(step, num_columns), row] for which in (0, 1))
        return tuple(plgpu.load(p, mask=inside(step), other=0.0) for p in places)

    # Now place r holds what row r sends up, and place `lanes` what comes from below: nothing.
    for slot in (0, 1):
        write(slot, 0, 1, none)
    wait()
    for slot in (0, 1):
        write(slot, 0, 0, none)
    wait()

    def back(number, carry):
        step = steps - 1 - number
        to_left, diagonal, (up_weight, left_weight) = carry
        later = weights_at(step - 1)
        here = to_left + read(jax.lax.rem(step + 1, 2), 0, 1) + jnp.where(end == step, 1.0, 0.0)
        up, to_left = up_weight * here, left_weight * here
        write(jax.lax.rem(step, 2), 0, 0, up + diagonal)
        plgpu.store(flow.at[pair, row, cell(step)], here, mask=inside(step))
        wait()
        return to_left, jnp.maximum(here - up - to_left, 0.0), later

    jax.lax.fori_loop(0, steps, back, (none, none, weights_at(jnp.int32(steps - 1))))
