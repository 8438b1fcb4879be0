"""Soft dynamic time warping (Cuturi and Blondel, ICML 2017) and its divergence.

Two sequences are compared along the best monotone alignment of their frames; soft-DTW replaces
the minimum over alignments by a soft minimum, min_gamma(a) = -gamma log(sum of exp(-a / gamma)),
so that it has a gradient: the expected alignment. Shapes use T and S for frames and D for
features. Leading axes are a batch, which is one vector of lanes in the compiled loops, and
`jax.vmap` adds to the same lanes.

Derivatives. Forward and reverse mode work, and so do second derivatives. The first is exact and
stores two numbers per cell; reverse mode over the gradient itself is also exact, but records its
loops, so prefer forward over reverse (`jax.jvp` of `jax.grad`) for Hessian-vector products.
The derivative by gamma is (value - <alignment, cost>) / gamma, minus the alignments' entropy.

>>> cost = jnp.array([[0.0, 1.0], [1.0, 0.0]])
>>> soft_dtw(cost, gamma=0.1).round(4) + 0.0
Array(0., dtype=float32)
"""

import functools
import math
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float, Int

from ..errors import ConfigError, ShapeError
from .soft_dtw_wavefront import FORBIDDEN, recursion, strip_height

__all__ = [
    "expected_alignment",
    "pairwise_cost",
    "soft_dtw",
    "soft_dtw_between",
    "soft_dtw_divergence",
]

Implementation = Literal["auto", "scan", "pallas"]
Lengths = Int[Array, "..."] | int | None

# More rows than this make the kernel's vectors spill out of a GPU's registers.
_KERNEL_ROWS = 2048

# A traced gamma cannot be refused; below this it counts as this.
_LEAST_GAMMA = 1e-6


def soft_dtw(
    cost: Float[Array, "*batch T S"],
    lengths: Lengths = None,
    other_lengths: Lengths = None,
    *,
    gamma: Float[Array, "..."] | float = 1.0,
    band: int | None = None,
    implementation: Implementation = "auto",
) -> Float[Array, "*batch"]:
    """Soft minimum, over all monotone alignments, of the sum of their cells' costs.

    Args:
      cost: of matching frame t with frame s. Infinite where a match is forbidden; costs above
        1e20 count as 1e20. bfloat16 and float16 are computed in float32.
      lengths: rows that count, 0 to T, of the batch's shape or one for all; may be traced. What
        lies beyond does not matter, NaN included.
      other_lengths: columns that count, 0 to S.
      gamma: softness, above 0, in units of cost; of the batch's shape or one for all.
      band: Sakoe-Chiba radius. Cells further than this from the band between the two corners
        are forbidden; for unequal lengths the band is wider by their difference.
      implementation: "scan" is plain JAX and runs everywhere; "pallas" is one kernel and needs a
        CUDA GPU; "auto" takes the kernel where it can run.

    Returns:
      One value per pair, float32 (float64 for float64 costs), in units of cost; not divided by
      the length, and possibly negative. An empty sequence gives 0 with zero gradient.

    Raises:
      ShapeError: no rows, no columns, or a length that does not fit.
      ConfigError: gamma is not positive, the band is negative, or the implementation is unknown
        or cannot run here.
    """
    problem = prepare(cost, lengths, other_lengths, gamma, band)
    return best_value(*problem, _chosen(implementation, problem), False).reshape(cost.shape[:-2])


def expected_alignment(
    cost: Float[Array, "*batch T S"],
    lengths: Lengths = None,
    other_lengths: Lengths = None,
    *,
    gamma: Float[Array, "..."] | float = 1.0,
    band: int | None = None,
    implementation: Implementation = "auto",
) -> Float[Array, "*batch T S"]:
    """Probability that an alignment drawn from the Gibbs distribution visits each cell.

    This is the derivative of `soft_dtw` by its cost; arguments and errors are the same. Each row
    and each column that counts sums to at least 1, cells beyond the lengths are 0.
    """
    problem = prepare(cost, lengths, other_lengths, gamma, band)
    _, alignment = best_value_and_alignment(*problem, _chosen(implementation, problem), False)
    return alignment.reshape(cost.shape)


def soft_dtw_between(
    query: Float[Array, "*batch T D"],
    other: Float[Array, "*batch S D"],
    lengths: Lengths = None,
    other_lengths: Lengths = None,
    *,
    gamma: Float[Array, "..."] | float = 1.0,
    band: int | None = None,
    implementation: Implementation = "auto",
) -> Float[Array, "*batch"]:
    """`soft_dtw` of two sequences under the squared Euclidean distance of their frames."""
    cost = pairwise_cost(query, other, lengths, other_lengths)
    options = {"gamma": gamma, "band": band, "implementation": implementation}
    return soft_dtw(cost, lengths, other_lengths, **options)


def soft_dtw_divergence(
    query: Float[Array, "*batch T D"],
    other: Float[Array, "*batch S D"],
    lengths: Lengths = None,
    other_lengths: Lengths = None,
    *,
    gamma: Float[Array, "..."] | float = 1.0,
    band: int | None = None,
    implementation: Implementation = "auto",
) -> Float[Array, "*batch"]:
    """Soft-DTW less half of each sequence's soft-DTW with itself (Blondel et al., AISTATS 2021).

    It is 0 for equal sequences, where soft-DTW itself is negative and not at its minimum. It is
    meant to be positive elsewhere, as it was in all tests with squared distances.
    Arguments and errors are those of `soft_dtw_between`.
    """
    options = {"gamma": gamma, "band": band, "implementation": implementation}
    pairs = [
        (query, other, lengths, other_lengths),
        (query, query, lengths, lengths),
        (other, other, other_lengths, other_lengths),
    ]
    if query.shape == other.shape:  # one loop over all three instead of one after the other
        batch = query.shape[:-2]
        whole = query.shape[-2]
        pairs = [(*pair[:2], *(_spread(n, whole, batch) for n in pair[2:])) for pair in pairs]
        across, within, other_within = soft_dtw_between(
            *(jnp.stack(arrays) for arrays in zip(*pairs, strict=True)), **options
        )
    else:
        across, within, other_within = (soft_dtw_between(*pair, **options) for pair in pairs)
    return across - 0.5 * (within + other_within)


def pairwise_cost(
    query: Float[Array, "*batch T D"],
    other: Float[Array, "*batch S D"],
    lengths: Lengths = None,
    other_lengths: Lengths = None,
) -> Float[Array, "*batch T S"]:
    """Squared Euclidean distance of each frame of one sequence to each of the other.

    It is the expanded square, one matrix product. Both sequences are first moved by the query's
    first frame, since digits are lost when features lie far from zero. Frames beyond the lengths
    count as that frame, whatever they hold.

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
    origin = jax.lax.stop_gradient(query[..., :1, :].astype(dtype))
    moved = []
    for sequence, count in ((query, lengths), (other, other_lengths)):
        frames = sequence.astype(dtype) - origin
        if count is not None:
            count = _spread(count, sequence.shape[-2], sequence.shape[:-2])
            counts = jnp.arange(sequence.shape[-2]) < count[..., None]
            frames = jnp.where(counts[..., None], frames, 0.0)
        moved.append(frames)
    query, other = moved
    products = jnp.einsum("...td,...sd->...ts", query, other, precision="highest")
    squares, other_squares = (jnp.sum(jnp.square(x), axis=-1) for x in (query, other))
    return jnp.maximum(squares[..., :, None] + other_squares[..., None, :] - 2.0 * products, 0.0)


# --- what the modules beside this one use too


class Problem(NamedTuple):
    """Checked arguments with the batch as one axis; forbidden cells have cost `FORBIDDEN`."""

    cost: Float[Array, "B T S"]
    gamma: Float[Array, "B"]
    rows: Int[Array, "B"]
    columns: Int[Array, "B"]


def prepare(cost, lengths, other_lengths, gamma, band) -> Problem:
    """Check the arguments of `soft_dtw` and bring them into one form."""
    if cost.ndim < 2 or 0 in cost.shape[-2:]:
        raise ShapeError(
            f"cost has shape {cost.shape}, but needs two axes at its end, of one frame or more each"
        )
    if band is not None and band < 0:
        raise ConfigError(f"band is {band}, but must be 0 or more, or None for no band")
    batch, (height, width) = cost.shape[:-2], cost.shape[-2:]
    pairs = math.prod(batch)
    _check_gamma(gamma, batch)
    _check_lengths("lengths", lengths, height, cost.shape)
    _check_lengths("other_lengths", other_lengths, width, cost.shape)

    dtype = jnp.promote_types(cost.dtype, jnp.float32)
    rows = _spread(lengths, height, batch).reshape(pairs)
    columns = _spread(other_lengths, width, batch).reshape(pairs)
    empty = (rows == 0) | (columns == 0)
    rows, columns = jnp.where(empty, 0, rows), jnp.where(empty, 0, columns)
    gamma = jnp.maximum(jnp.asarray(gamma, dtype), _LEAST_GAMMA)
    gamma = jnp.broadcast_to(gamma, batch).reshape(pairs)
    cost = jnp.clip(cost.astype(dtype), -FORBIDDEN, FORBIDDEN).reshape(pairs, height, width)

    row, column = jnp.arange(height)[:, None], jnp.arange(width)
    if lengths is not None or other_lengths is not None:
        inside = (row < rows[:, None, None]) & (column < columns[:, None, None])
        cost = jnp.where(inside, cost, FORBIDDEN)
    if band is not None:
        skewness = (rows - columns)[:, None, None]
        low, high = jnp.minimum(skewness, 0) - band, jnp.maximum(skewness, 0) + band
        cost = jnp.where((row - column >= low) & (row - column <= high), cost, FORBIDDEN)
    return Problem(cost, gamma, rows, columns)


@functools.partial(jax.custom_jvp, nondiff_argnums=(4, 5))
def best_value(cost, gamma, rows, columns, implementation, hard):
    """The minimum over alignments of each pair, soft or hard; fields of a `Problem` first."""
    return _batched(implementation, hard, False)(cost, gamma, rows, columns)[0]


def _best_value_rule(implementation, hard, primals, tangents):
    """Envelope theorem: move along the expected alignment. Unused tangents cost nothing."""
    cost, gamma, *_ = primals
    cost_tangent, gamma_tangent, *_ = tangents
    value, alignment = best_value_and_alignment(*primals, implementation, hard)
    tangent = jnp.zeros_like(value)
    if not isinstance(cost_tangent, SymbolicZero):
        tangent += jnp.sum(alignment * cost_tangent, axis=(1, 2))
    if not isinstance(gamma_tangent, SymbolicZero) and not hard:
        mean = jnp.sum(alignment * cost, axis=(1, 2))
        tangent += (value - mean) / gamma * gamma_tangent
    return value, tangent


best_value.defjvp(_best_value_rule, symbolic_zeros=True)


@functools.partial(jax.custom_jvp, nondiff_argnums=(4, 5))
def best_value_and_alignment(cost, gamma, rows, columns, implementation, hard):
    """`best_value` with its derivative by the cost, from one pass forth and one back."""
    return _batched(implementation, hard, True)(cost, gamma, rows, columns)


@best_value_and_alignment.defjvp
def _best_value_and_alignment_rule(implementation, hard, primals, tangents):
    cost, gamma, rows, columns = primals

    def both(cost, gamma):
        return _scan(cost, gamma, rows, columns, hard=hard, alignment=True)

    return jax.jvp(both, (cost, gamma), tangents[:2])


@functools.cache
def _batched(implementation, hard, alignment):
    """The compiled recursion; vmap makes more lanes of it, not another loop."""
    run = _kernel() if implementation == "pallas" else _scan
    run = custom_vmap(jax.jit(functools.partial(run, hard=hard, alignment=alignment)))

    @run.def_vmap
    def more_lanes(size, is_batched, *arguments):
        merged = []
        for x, batched in zip(arguments, is_batched, strict=True):
            x = x if batched else jnp.broadcast_to(x, (size, *x.shape))
            merged.append(x.reshape(x.shape[0] * x.shape[1], *x.shape[2:]))
        out = jax.tree.map(lambda x: x.reshape(size, -1, *x.shape[1:]), run(*merged))
        return out, jax.tree.map(lambda _: True, out)

    return run


def _scan(cost, gamma, rows, columns, *, hard, alignment):
    """The recursion in the loop order of the platform that it is compiled for."""
    pairs, height, _ = cost.shape
    if pairs == 0:
        return gamma, cost if alignment else None

    def on(platform):
        strip = strip_height(pairs, height, platform=platform)
        return functools.partial(recursion, height=strip, hard=hard, alignment=alignment)

    arguments = cost, gamma, rows, columns
    return jax.lax.platform_dependent(*arguments, cpu=on("cpu"), default=on("other"))


def _chosen(implementation: str, problem: Problem) -> str:
    """What "auto" means here: the backend, sizes and dtype are known when a program is traced."""
    if implementation not in ("auto", "scan", "pallas"):
        raise ConfigError(f'implementation is {implementation!r}, not "auto", "scan" or "pallas"')
    if implementation == "scan":
        return "scan"
    reason = _why_no_kernel(problem.cost)
    if reason and implementation == "pallas":
        raise ConfigError(f'implementation="pallas" {reason}; take "auto" or "scan"')
    return "scan" if reason else "pallas"


def _why_no_kernel(cost):
    """Why the GPU kernel cannot run, or an empty string."""
    if jax.default_backend() != "gpu":
        return f"needs a CUDA GPU, but JAX runs on {jax.default_backend()}"
    if cost.dtype != jnp.float32:
        return f"computes in float32, but cost is {cost.dtype}"
    if cost.shape[1] > _KERNEL_ROWS:
        return f"holds {_KERNEL_ROWS} rows at most, but cost has {cost.shape[1]}"
    return ""


def _kernel():
    # On a CPU Pallas is never imported: it costs time and may be missing there.
    from .soft_dtw_pallas import kernel

    def run(*arguments, hard, alignment):
        scan = functools.partial(_scan, hard=hard, alignment=alignment)
        if hard or 0 in arguments[0].shape:
            return scan(*arguments)
        # A GPU that is not CUDA's, or a program compiled for the CPU beside the GPU.
        cuda = functools.partial(kernel, alignment=alignment)
        return jax.lax.platform_dependent(*arguments, cuda=cuda, default=scan)

    return run


def _spread(lengths, whole, batch):
    """Lengths of the batch's shape, at most the number of frames that there are."""
    lengths = whole if lengths is None else lengths
    return jnp.clip(jnp.broadcast_to(jnp.asarray(lengths, jnp.int32), batch), 0, whole)


def _known(x):
    """Whether values can be looked at now; the others are made safe inside the program."""
    return not isinstance(x, jax.core.Tracer)


def _check_gamma(gamma, batch):
    _check_spreads("gamma", gamma, batch)
    if _known(gamma):
        with jax.ensure_compile_time_eval():
            if not jnp.all(jnp.asarray(gamma) > 0):
                raise ConfigError(f"gamma is {gamma}, but must be above 0 (at 0 take `dtw`)")


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
