"""The two recursions of soft dynamic time warping, as compiled loops over strips of rows.

Cells of one anti-diagonal do not depend on each other, and neither do the pairs of a batch, so both
are lanes of one vector. A GPU takes all rows at once, because each step is a launch. A CPU takes
strips of rows: larger ones waste time on cells outside of the matrix, smaller ones on overhead.

Each sum is kept as two floats (Knuth's two-sum); in float32 its rounding would be most of the
gradient's error. The backward recursion multiplies by weights that the forward one has stored, so
that mass is conserved. Shapes: B for pairs, T and S for rows and columns of the cost. K is for the
rows of a strip and W = S + K - 1 for its anti-diagonals.
"""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

# Cost of a cell that no path may enter. Finite, because inf - inf is NaN; its exponential is 0 for
# every gamma, and its square over gamma squared still fits into float32.
FORBIDDEN = 1e20

# Lanes of a step on a CPU, so many that its overhead is small. Measured with 16 to 64 pairs of 64
# to 256 frames: 512 take as long to 15 % longer and a sixth less memory, 2048 up to a third longer.
_CPU_LANES = 1024


def strip_height(num_pairs: int, num_rows: int, *, platform: str) -> int:
    """Rows of a strip: about 1024 lanes a step on a CPU, all rows elsewhere."""
    if platform != "cpu":
        return num_rows
    return max(1, min(num_rows, _CPU_LANES // num_pairs))


def recursion(
    cost: Float[Array, "B T S"],
    gamma: Float[Array, "B"],
    rows: Int[Array, "B"],
    columns: Int[Array, "B"],
    *,
    height: int,
    alignment: bool = True,
) -> tuple[Float[Array, "B"], Float[Array, "B T S"] | None]:
    """Value of the best path to cell (rows - 1, columns - 1), and its derivative by the cost.

    Args:
      cost: of each cell, at most `FORBIDDEN` in magnitude, float32 or float64.
      gamma: softness of the minimum.
      rows: number of rows of each pair that count; a pair with none has value and derivative 0.
      columns: number of columns that count. Both are 0, or neither is.
      height: rows of a strip, K; it changes speed and memory, not the numbers.
      alignment: also return the derivative; without it nothing is stored.

    Returns:
      The values, and the derivative or None.
    """
    num_pairs, num_rows, num_columns = cost.shape
    strips = _skew(cost, height)
    in_strip = jnp.repeat(jnp.arange(height), num_pairs)  # row of a lane within its strip
    end_row, end_column = (jnp.tile(n - 1, height) for n in (rows, columns))
    # At this step of its strip a lane holds the cell where its path ends; -1 is never.
    start = height * jnp.arange(len(strips))[:, None]
    end = jnp.where(in_strip + start == end_row, end_column + in_strip, -1)
    soften = functools.partial(soft_minimum, jnp.tile(gamma, height))
    value, weights = _forward(strips, end, soften, num_pairs, alignment)
    if not alignment:
        return value, None
    flow = _backward(*weights, end, num_pairs)
    return value, _unskew(flow, num_pairs, num_rows, num_columns, height)


def _forward(strips, end, soften, num_pairs, keep_weights):
    """Sums from the first cell on; returns the sums at the ends and the weights of up and left."""
    _, num_steps, num_lanes = strips.shape
    dtype = strips.dtype
    height = num_lanes // num_pairs
    num_columns = num_steps - height + 1
    outside = jnp.full((num_columns + 1, num_pairs), FORBIDDEN, dtype)
    beyond = jnp.full((height, num_pairs), FORBIDDEN, dtype)
    column = jnp.full((num_lanes,), FORBIDDEN, dtype)

    def strip(carry, x):
        value, above = carry  # sums of the row above, high and low, from column -1 on
        costs, end = x

        def step(carry, x):
            value, (high, low), older, now = carry
            cost, (above_high, above_low) = x
            up, left = (high[:num_lanes], low[:num_lanes]), (high[num_pairs:], low[num_pairs:])
            (new_high, new_low), weights = soften(up, left, older, cost)
            value = jnp.where(end == now, new_high + new_low, value)
            sums = jnp.concatenate([above_high, new_high]), jnp.concatenate([above_low, new_low])
            below = new_high[-num_pairs:], new_low[-num_pairs:]
            return (value, sums, up, now + 1), (below, weights if keep_weights else None)

        def joined(join, rows, fill):  # the high parts with the fill, the low ones with zeros
            return tuple(
                jnp.concatenate(join(*x)) for x in zip(rows, (fill, 0 * fill), strict=True)
            )

        sums = joined(lambda row, fill: [row[1], fill], above, column)
        diagonal = joined(lambda row, fill: [row[0], fill[num_pairs:]], above, column)
        later = joined(lambda row, fill: [row[2:], fill], above, beyond)
        (value, *_), (below, weights) = jax.lax.scan(
            step, (value, sums, diagonal, 0), (costs, later)
        )
        below = joined(lambda row, fill: [fill[:1], row[height - 1 :]], below, outside)
        return (value, below), weights

    # Before the first row there is one place to come from: the corner, at cost 0.
    first = outside.at[0].set(0.0), jnp.zeros_like(outside)
    (value, _), weights = jax.lax.scan(strip, (jnp.zeros(num_lanes, dtype), first), (strips, end))
    return jnp.sum(value.reshape(height, num_pairs), axis=0), weights


def _backward(up_weights, left_weights, end, num_pairs):
    """Flow of one unit from each end back to the first cell: the derivative by each cost."""
    _, num_steps, num_lanes = up_weights.shape
    height = num_lanes // num_pairs
    num_columns = num_steps - height + 1
    empty = jnp.zeros((num_lanes,), up_weights.dtype)
    late = jnp.zeros((height - 1, num_pairs), up_weights.dtype)

    def strip(below, x):
        *weights, end = x

        def step(carry, x):
            # to_left flows within a row; upward joins what goes up and, one step older, diagonally
            to_left, upward, diagonal, now = carry
            up_weight, left_weight, below = x
            here = to_left + jnp.concatenate([upward[num_pairs:], below])
            here = here + (end == now).astype(here.dtype)
            up, to_left = up_weight * here, left_weight * here
            upward, diagonal = up + diagonal, jnp.maximum(here - up - to_left, 0.0)
            return (to_left, upward, diagonal, now - 1), (here, upward[:num_pairs])

        init = empty, empty, empty, num_steps - 1
        below = jnp.concatenate([late, below])
        _, (flow, above) = jax.lax.scan(step, init, (*weights, below), reverse=True)
        return above[:num_columns], flow

    last = jnp.zeros((num_columns, num_pairs), up_weights.dtype)
    _, flow = jax.lax.scan(strip, last, (up_weights, left_weights, end), reverse=True)
    return flow


def soft_minimum(gamma, up, left, diagonal, cost):
    """cost - gamma log(sum of exp(-sum / gamma)) as two floats; weights of up and of left."""
    least = jnp.minimum(jnp.minimum(up[0], left[0]), diagonal[0])
    excess = [(high - least) + low for high, low in (up, left, diagonal)]
    rest = functools.reduce(jnp.minimum, excess)
    sharpness = 1.0 / gamma  # products: divisions took a twelfth of the time
    from_up, from_left, from_diagonal = (jnp.exp((rest - e) * sharpness) for e in excess)
    total = from_up + from_left + from_diagonal  # between 1 and 3
    share = 1.0 / total
    return (
        _two_floats(least, cost, rest - gamma * jnp.log(total)),
        (from_up * share, from_left * share),
    )


def _two_floats(a, b, small):
    """a + b + small for small far below a + b, keeping the rounding error of a + b."""
    high = a + b
    b_part = high - a
    low = (a - (high - b_part)) + (b - b_part) + small
    total = high + low
    return total, low - (total - high)


def _skew(cost, height):
    """Strips with anti-diagonals as rows: (strips, W, K x B); cells outside are forbidden.

    Rows are padded by K columns. The same numbers are then cut into rows one shorter, so that each
    row is shifted by one more column than the row before. Anti-diagonals become columns.
    """
    num_pairs, num_rows, num_columns = cost.shape
    strips, steps = -(-num_rows // height), num_columns + height - 1
    missing = strips * height - num_rows
    cost = jnp.pad(cost, ((0, 0), (0, missing), (0, height)), constant_values=FORBIDDEN)
    cost = cost.reshape(num_pairs, strips, height * (steps + 1))[:, :, : height * steps]
    cost = cost.reshape(num_pairs, strips, height, steps)
    return cost.transpose(1, 3, 2, 0).reshape(strips, steps, height * num_pairs)


def _unskew(flow, num_pairs, num_rows, num_columns, height):
    strips, steps, _ = flow.shape
    flow = flow.reshape(strips, steps, height, num_pairs).transpose(3, 0, 2, 1)
    flow = flow.reshape(num_pairs, strips, height * steps)
    flow = jnp.pad(flow, ((0, 0), (0, 0), (0, height)))
    flow = flow.reshape(num_pairs, strips * height, steps + 1)
    return flow[:, :num_rows, :num_columns]
