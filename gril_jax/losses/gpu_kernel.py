"""Soft-DTW, both recursions, as one kernel for CUDA GPUs (Pallas on Triton).

One program takes one pair through all anti-diagonals, where compiled loops launch kernels for each.
A row of the cost is a lane, which needs its upper neighbour's sums. Lanes write them to a small
buffer that stays in cache, with one barrier an anti-diagonal. Weights are stored by (step mod S,
row): a row is inside of the matrix for S consecutive steps, so that each place is used once.
This module is imported by `soft_dtw` alone, and only where a GPU is.
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.experimental import pallas as pl
from jax.experimental.pallas import triton as plgpu
from jaxtyping import Array, Float, Int

from .recursion import FORBIDDEN, soft_minimum


def kernel(
    cost: Float[Array, "B T S"],
    gamma: Float[Array, "B"],
    rows: Int[Array, "B"],
    columns: Int[Array, "B"],
    *,
    alignment: bool = True,
    interpret: bool = False,
) -> tuple[Float[Array, "B"], Float[Array, "B T S"] | None]:
    """`recursion.recursion` in float32; `interpret` runs it on any device."""
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


class _Pair(NamedTuple):
    """One pair inside the kernel: a lane for each row, and the exchange between lanes."""

    index: Int[Array, ""]  # of the pair in the batch
    row: Int[Array, "lanes"]
    shape: tuple[int, int]  # of the cost
    exchange: Any  # reference to (pairs, 2 slots, 2 parts, lanes + 1)
    barrier: bool

    def inside(self, step):
        """Lanes whose row has a cell on this anti-diagonal."""
        num_rows, num_columns = self.shape
        return (self.row < num_rows) & (step >= self.row) & (step - self.row < num_columns)

    def cell(self, step):
        """Columns of the lanes' cells, clipped into range for lanes that are outside."""
        return jnp.clip(step - self.row, 0, self.shape[1] - 1)

    def wait(self):
        if self.barrier:
            plgpu.debug_barrier()

    def read(self, slot, part, shift):
        place = self.exchange.at[self.index, slot, part, self.row + shift]
        return plgpu.load(place, volatile=True)

    def write(self, slot, part, shift, x):
        plgpu.store(self.exchange.at[self.index, slot, part, self.row + shift], x)

    def fill(self, shift, *parts):
        """Fills both slots of the exchange, before a recursion begins."""
        for slot in (0, 1):
            for part, x in enumerate(parts):
                self.write(slot, part, shift, x)
        self.wait()

    def stored(self, weights, which, step):
        """Location where the lanes store one of their cells' two weights on this anti-diagonal."""
        return weights.at[self.index, which, jax.lax.rem(step, self.shape[1]), self.row]


def _program(cost, gamma, rows, columns, value, exchange, *rest, shape, lanes, barrier):
    """Computes one pair: sums from the first anti-diagonal to the last, then the flow back."""
    pair = _Pair(pl.program_id(0), jnp.arange(lanes), shape, exchange, barrier)
    end_row, end_column = rows[pair.index] - 1, columns[pair.index] - 1
    # The step at which a lane holds the cell where the path ends; -1 is never.
    end = jnp.where(pair.row == end_row, end_column + pair.row, -1)
    flow, weights = rest or (None, None)
    value[pair.index] = _forth(pair, cost, gamma, end, weights)
    if rest:
        _back(pair, end, weights, flow)


def _forth(pair, cost, gamma, end, kept):
    """The sum at the path's end. Writes the weights of up and left to `kept`, if given."""
    num_rows, num_columns = pair.shape
    edge = jnp.full(pair.row.shape, FORBIDDEN, jnp.float32)
    none = jnp.zeros(pair.row.shape, jnp.float32)
    softness = gamma[pair.index]

    def costs(step):
        place = cost.at[pair.index, jnp.minimum(pair.row, num_rows - 1), pair.cell(step)]
        return plgpu.load(place, mask=pair.inside(step), other=FORBIDDEN)

    def one(step, carry):
        ended, left, diagonal, here = carry
        later = costs(step + 1)  # asked for before the barrier, needed after it
        up = tuple(pair.read(jax.lax.rem(step + 1, 2), part, 0) for part in (0, 1))
        sums, weights = soft_minimum(softness, up, left, diagonal, here)
        ended = jnp.where(end == step, sums[0] + sums[1], ended)
        for part in (0, 1):
            pair.write(jax.lax.rem(step, 2), part, 1, sums[part])
        if kept is not None:
            for which in (0, 1):
                place = pair.stored(kept, which, step)
                plgpu.store(place, weights[which], mask=pair.inside(step))
        pair.wait()
        return ended, sums, up, later

    # Place r + 1 of the exchange holds row r, place 0 the row above the first, always forbidden.
    pair.fill(0, edge, none)
    pair.fill(1, edge, none)
    corner = jnp.where(pair.row == 0, 0.0, edge)
    init = none, (edge, none), (corner, none), costs(0)
    ended, *_ = jax.lax.fori_loop(0, num_rows + num_columns - 1, one, init)
    return jnp.sum(ended)


def _back(pair, end, kept, flow):
    """Computes the flow of one unit back from the path's end, by the weights from `_forth`."""
    steps = sum(pair.shape) - 1
    none = jnp.zeros(pair.row.shape, jnp.float32)

    def weights_at(step):
        step = jnp.maximum(step, 0)
        places = (pair.stored(kept, which, step) for which in (0, 1))
        return tuple(plgpu.load(p, mask=pair.inside(step), other=0.0) for p in places)

    def one(number, carry):
        step = steps - 1 - number
        to_left, diagonal, (up_weight, left_weight) = carry
        later = weights_at(step - 1)
        from_below = pair.read(jax.lax.rem(step + 1, 2), 0, 1)
        here = to_left + from_below + jnp.where(end == step, 1.0, 0.0)
        up, to_left = up_weight * here, left_weight * here
        pair.write(jax.lax.rem(step, 2), 0, 0, up + diagonal)
        place = flow.at[pair.index, pair.row, pair.cell(step)]
        plgpu.store(place, here, mask=pair.inside(step))
        pair.wait()
        return to_left, jnp.maximum(here - up - to_left, 0.0), later

    # Now place r holds what row r sends up, and the last what comes from below it: nothing.
    pair.fill(1, none)
    pair.fill(0, none)
    jax.lax.fori_loop(0, steps, one, (none, none, weights_at(jnp.int32(steps - 1))))
