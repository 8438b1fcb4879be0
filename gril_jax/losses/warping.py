"""Soft dynamic time warping's arguments, checked and in one form, and its value's derivatives.

The recursion itself is in `recursion`. Here it becomes a function with derivatives of its own, and
vmap makes more lanes of it. Shapes use T and S for frames, D for features, and B for pairs: all
axes of a batch as one.
"""

import functools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float, Int

from gril_jax.errors import ConfigError, ShapeError
from gril_jax.types import checked

from .recursion import FORBIDDEN, recursion, strip_height

Lengths = Int[Array, "..."] | int | None

# A traced gamma cannot be refused; below this it counts as this.
_LEAST_GAMMA = 1e-6


@checked
def pairwise_cost(
    query: Float[Array, "*batch T D"],
    other: Float[Array, "*batch S D"],
    lengths: Lengths = None,
    other_lengths: Lengths = None,
) -> Float[Array, "*batch T S"]:
    """Squared Euclidean distance of each frame of one sequence to each of the other.

    It is the expanded square, one matrix product. Both sequences are first moved by the query's
    first frame, since digits are lost when features lie far from zero. Frames beyond the lengths
    count as that frame, whatever they hold. A number whose square would overflow, beyond about 1e18
    in float32, counts as the largest that does not, with gradient zero.

    >>> pairwise_cost(jnp.array([[0.0], [1.0]]), jnp.array([[0.0], [3.0]])).tolist()
    [[0.0, 9.0], [1.0, 4.0]]

    Raises:
      ShapeError: the batches or the features differ.
    """
    shapes = query.shape, other.shape
    if query.ndim < 2 or shapes[0][:-2] != shapes[1][:-2] or shapes[0][-1] != shapes[1][-1]:
        raise ShapeError(
            f"query has shape {shapes[0]} and other {shapes[1]}, but they must agree in everything "
            "except the number of frames, the last axis but one"
        )
    dtype = jnp.promote_types(jnp.promote_types(query.dtype, other.dtype), jnp.float32)
    if 0 in (shapes[0][-2], shapes[1][-2]):
        return jnp.zeros((*shapes[0][:-1], shapes[1][-2]), dtype)
    most = jnp.asarray((float(jnp.finfo(dtype).max) / (8 * max(shapes[0][-1], 1))) ** 0.5, dtype)
    bounded = lambda x: jax.lax.clamp(-most, x.astype(dtype), most)  # noqa: E731
    origin = jax.lax.stop_gradient(bounded(query[..., :1, :]))
    moved = []
    for sequence, count in ((query, lengths), (other, other_lengths)):
        frames = bounded(sequence.astype(dtype) - origin)
        if count is not None:
            count = spread(count, sequence.shape[-2], sequence.shape[:-2])
            counts = jnp.arange(sequence.shape[-2]) < count[..., None]
            frames = jnp.where(counts[..., None], frames, 0.0)
        moved.append(frames)
    query, other = moved
    products = jnp.einsum("...td,...sd->...ts", query, other, precision="highest")
    squares, other_squares = (jnp.sum(jnp.square(x), axis=-1) for x in (query, other))
    return jnp.maximum(squares[..., :, None] + other_squares[..., None, :] - 2.0 * products, 0.0)


class Problem(NamedTuple):
    """Checked arguments with the batch as one axis; forbidden cells have cost `FORBIDDEN`."""

    cost: Float[Array, "B T S"]
    gamma: Float[Array, "B"]
    rows: Int[Array, "B"]
    columns: Int[Array, "B"]


def prepare(cost, lengths, other_lengths, gamma) -> Problem:
    """Checks the arguments of `soft_dtw` and brings them into one form."""
    if cost.ndim < 2 or 0 in cost.shape[-2:]:
        raise ShapeError(
            f"cost has shape {cost.shape}, but needs two axes at its end, of one frame or more each"
        )
    batch, (height, width) = cost.shape[:-2], cost.shape[-2:]
    pairs = math.prod(batch)
    _check_gamma(gamma, batch)
    _check_lengths("lengths", lengths, height, cost.shape)
    _check_lengths("other_lengths", other_lengths, width, cost.shape)

    dtype = jnp.promote_types(cost.dtype, jnp.float32)
    rows = spread(lengths, height, batch).reshape(pairs)
    columns = spread(other_lengths, width, batch).reshape(pairs)
    empty = (rows == 0) | (columns == 0)
    rows, columns = jnp.where(empty, 0, rows), jnp.where(empty, 0, columns)
    gamma = jnp.maximum(jnp.asarray(gamma, dtype), _LEAST_GAMMA)
    gamma = jnp.broadcast_to(gamma, batch).reshape(pairs)
    cost = jnp.clip(cost.astype(dtype), -FORBIDDEN, FORBIDDEN).reshape(pairs, height, width)

    row, column = jnp.arange(height)[:, None], jnp.arange(width)
    if lengths is not None or other_lengths is not None:
        inside = (row < rows[:, None, None]) & (column < columns[:, None, None])
        cost = jnp.where(inside, cost, FORBIDDEN)
    return Problem(cost, gamma, rows, columns)


def spread(lengths: Lengths, whole: int, batch: tuple[int, ...]) -> Int[Array, "..."]:
    """Lengths broadcast to the batch's shape and limited to the number of frames."""
    lengths = whole if lengths is None else lengths
    return jnp.clip(jnp.broadcast_to(jnp.asarray(lengths, jnp.int32), batch), 0, whole)


def _known(x):
    """True if values are known now; traced ones are made safe inside the program."""
    return not isinstance(x, jax.core.Tracer)


def _check_gamma(gamma, batch):
    if isinstance(gamma, str):
        raise ConfigError(f"gamma is {gamma!r:.60}, but must be above 0")
    _check_spreads("gamma", gamma, batch)
    if _known(gamma):
        with jax.ensure_compile_time_eval():
            if not jnp.all(jnp.asarray(gamma) > 0):
                raise ConfigError(f"gamma is {gamma}, but must be above 0")


def _check_lengths(name, lengths, whole, shape):
    if lengths is None:
        return
    _check_spreads(name, lengths, shape[:-2])
    if _known(lengths):
        with jax.ensure_compile_time_eval():
            values = jnp.asarray(lengths)
            if not jnp.all((values >= 0) & (values <= whole)):
                raise ShapeError(
                    f"{name} is {lengths}, but must be from 0 to {whole} for cost of shape {shape}"
                )


def _check_spreads(name, values, batch):
    shape = jnp.shape(values)
    fits = len(shape) <= len(batch) and all(
        a in (1, b) for a, b in zip(reversed(shape), reversed(batch), strict=False)
    )
    if not fits:
        raise ShapeError(f"{name} has shape {shape}, which does not spread over the batch {batch}")


@functools.partial(jax.custom_jvp, nondiff_argnums=(4,))
def best_value(cost, gamma, rows, columns, implementation):
    """The soft minimum over alignments of each pair; fields of a `Problem` first."""
    return _batched(implementation, False)(cost, gamma, rows, columns)[0]


def _best_value_rule(implementation, primals, tangents):
    """Derivative along the expected alignment (envelope theorem). Unused tangents cost nothing."""
    cost_tangent, gamma_tangent, *_ = tangents
    value, alignment = best_value_and_alignment(*primals, implementation)
    tangent = jnp.zeros_like(value)
    if not isinstance(cost_tangent, SymbolicZero):
        tangent += jnp.sum(alignment * cost_tangent, axis=(1, 2))
    if not isinstance(gamma_tangent, SymbolicZero):
        tangent += _slope_by_gamma(*primals) * gamma_tangent
    return value, tangent


best_value.defjvp(_best_value_rule, symbolic_zeros=True)


@jax.jit
def _slope_by_gamma(cost, gamma, rows, columns):
    """The derivative by gamma, carried along with the sums: minus the entropy of the alignments.

    (value - <alignment, cost>) / gamma is the same, but a small difference of large numbers. In
    float32 its error is some per cent where gamma is a ten-thousandth of the value.
    """

    def value(gamma):
        return scan(cost, gamma, rows, columns, alignment=False)[0]

    return jax.jvp(value, (gamma,), (jnp.ones_like(gamma),))[1]


@functools.partial(jax.custom_jvp, nondiff_argnums=(4,))
def best_value_and_alignment(cost, gamma, rows, columns, implementation):
    """`best_value` and its derivative by the cost, from one forward and one backward pass."""
    return _batched(implementation, True)(cost, gamma, rows, columns)


@best_value_and_alignment.defjvp
def _best_value_and_alignment_rule(implementation, primals, tangents):
    cost, gamma, rows, columns = primals

    def both(cost, gamma):
        return scan(cost, gamma, rows, columns, alignment=True)

    return jax.jvp(both, (cost, gamma), tangents[:2])


@functools.cache
def _batched(implementation, alignment):
    """The compiled recursion, batched: vmap adds lanes to it instead of another loop."""
    run = scan if implementation == "scan" else implementation
    run = custom_vmap(jax.jit(functools.partial(run, alignment=alignment)))

    @run.def_vmap
    def more_lanes(size, is_batched, *arguments):
        merged = []
        for x, batched in zip(arguments, is_batched, strict=True):
            x = x if batched else jnp.broadcast_to(x, (size, *x.shape))
            merged.append(x.reshape(x.shape[0] * x.shape[1], *x.shape[2:]))
        out = jax.tree.map(lambda x: x.reshape(size, -1, *x.shape[1:]), run(*merged))
        return out, jax.tree.map(lambda _: True, out)

    return run


def scan(cost, gamma, rows, columns, *, alignment):
    """The recursion in the loop order of the platform it is compiled for."""
    pairs, height, _ = cost.shape
    if pairs == 0:
        return gamma, cost if alignment else None

    def on(platform):
        strip = strip_height(pairs, height, platform=platform)
        return functools.partial(recursion, height=strip, alignment=alignment)

    arguments = cost, gamma, rows, columns
    return jax.lax.platform_dependent(*arguments, cpu=on("cpu"), default=on("other"))
