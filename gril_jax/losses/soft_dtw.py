"""Soft dynamic time warping (Cuturi and Blondel, ICML 2017), and its divergence.

The soft minimum over the monotone alignments of two sequences' frames has a gradient: the expected
alignment. Forward and reverse mode work, second derivatives too, of which `jax.jvp` of `jax.grad`
is the cheaper. Shapes use T and S for frames and D for features. Leading axes are a batch, which is
one vector of lanes in the compiled loops; `jax.vmap` adds to the same lanes.

>>> cost = jnp.array([[0.0, 1.0], [1.0, 0.0]])
>>> soft_dtw(cost, gamma=0.1).round(4) + 0.0
Array(0., dtype=float32)
"""

import functools
from typing import Literal, TypedDict, Unpack

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from gril_jax.errors import ConfigError
from gril_jax.types import checked

from .warping import (
    Lengths,
    best_value,
    best_value_and_alignment,
    pairwise_cost,
    prepare,
    scan,
    spread,
)

Implementation = Literal["auto", "scan", "pallas"]

# More rows than this make the kernel's vectors spill out of a GPU's registers.
_KERNEL_ROWS = 2048


class WarpingOptions(TypedDict, total=False):
    """Options of soft-DTW; keyword arguments of every function of it."""

    gamma: Float[Array, "..."] | float
    """Softness, above 0, in units of cost; of the batch's shape or one for all; 1 if left out."""
    implementation: Implementation
    """"scan" is plain JAX and runs everywhere; "pallas" is one kernel and needs a CUDA GPU;
    "auto", the default, takes the kernel where it can run."""


@checked
def soft_dtw(
    cost: Float[Array, "*batch T S"],
    lengths: Lengths = None,
    other_lengths: Lengths = None,
    **options: Unpack[WarpingOptions],
) -> Float[Array, "*batch"]:
    """Soft minimum, over all monotone alignments, of the sum of their cells' costs.

    Args:
      cost: of matching frame t with frame s. Infinite where a match is forbidden; costs above
        1e20 count as 1e20. bfloat16 and float16 are computed in float32.
      lengths: rows that count, 0 to T, of the batch's shape or one for all; may be traced. What
        lies beyond does not matter, NaN included.
      other_lengths: columns that count, 0 to S.
      options: `WarpingOptions`.

    Returns:
      One value per pair, float32 (float64 for float64 costs), in units of cost; not divided by
      the length, and possibly negative. An empty sequence gives 0 with zero gradient.

    Raises:
      ShapeError: no rows, no columns, or a length that does not fit.
      ConfigError: gamma is not positive, or the implementation is unknown or cannot run here.
    """
    problem, chosen = _posed(cost, lengths, other_lengths, **options)
    return best_value(*problem, chosen).reshape(cost.shape[:-2])


@checked
def expected_alignment(
    cost: Float[Array, "*batch T S"],
    lengths: Lengths = None,
    other_lengths: Lengths = None,
    **options: Unpack[WarpingOptions],
) -> Float[Array, "*batch T S"]:
    """Probability that an alignment sampled from the Gibbs distribution visits each cell.

    This is the derivative of `soft_dtw` by its cost; arguments, options and errors are the same.
    Each row and each column that counts sums to at least 1, cells beyond the lengths are 0.
    """
    problem, chosen = _posed(cost, lengths, other_lengths, **options)
    _, alignment = best_value_and_alignment(*problem, chosen)
    return alignment.reshape(cost.shape)


@checked
def soft_dtw_between(
    query: Float[Array, "*batch T D"],
    other: Float[Array, "*batch S D"],
    lengths: Lengths = None,
    other_lengths: Lengths = None,
    **options: Unpack[WarpingOptions],
) -> Float[Array, "*batch"]:
    """`soft_dtw` of two sequences under the squared Euclidean distance of their frames.

    Raises:
      ShapeError: batches, features or lengths do not fit together.
      ConfigError: as for `soft_dtw`.
    """
    cost = pairwise_cost(query, other, lengths, other_lengths)
    return soft_dtw(cost, lengths, other_lengths, **options)


@checked
def soft_dtw_divergence(
    query: Float[Array, "*batch T D"],
    other: Float[Array, "*batch S D"],
    lengths: Lengths = None,
    other_lengths: Lengths = None,
    **options: Unpack[WarpingOptions],
) -> Float[Array, "*batch"]:
    """Soft-DTW minus half of each sequence's soft-DTW with itself (Blondel et al., AISTATS 2021).

    It is 0 for equal sequences, where soft-DTW itself is negative and not at its minimum. It is
    meant to be positive elsewhere, as it was in all tests with squared distances.
    Arguments, options and errors are those of `soft_dtw_between`.
    """
    between = functools.partial(soft_dtw_between, **options)
    pairs = [
        (query, other, lengths, other_lengths),
        (query, query, lengths, lengths),
        (other, other, other_lengths, other_lengths),
    ]
    if query.shape == other.shape:  # one loop over all three instead of one after the other
        batch = query.shape[:-2]
        whole = query.shape[-2]
        pairs = [(*pair[:2], *(spread(n, whole, batch) for n in pair[2:])) for pair in pairs]
        across, within, other_within = between(
            *(jnp.stack(arrays) for arrays in zip(*pairs, strict=True))
        )
    else:
        across, within, other_within = (between(*pair) for pair in pairs)
    return across - 0.5 * (within + other_within)


def _posed(cost, lengths, other_lengths, *, gamma=1.0, implementation="auto"):
    """The checked problem, and the implementation that computes it."""
    problem = prepare(cost, lengths, other_lengths, gamma)
    return problem, _chosen(implementation, problem)


def _chosen(implementation, problem):
    """The implementation; "auto" chooses by backend, sizes and dtype, known at trace time."""
    if implementation not in ("auto", "scan", "pallas"):
        raise ConfigError(f'implementation is {implementation!r}, not "auto", "scan" or "pallas"')
    if implementation == "scan":
        return "scan"
    reason = _why_no_kernel(problem.cost)
    if reason and implementation == "pallas":
        raise ConfigError(f'implementation="pallas" {reason}; take "auto" or "scan"')
    return "scan" if reason else _kernel()


def _why_no_kernel(cost):
    """The reason why the GPU kernel cannot run, or an empty string."""
    if jax.default_backend() != "gpu":
        return f"needs a CUDA GPU, but JAX runs on {jax.default_backend()}"
    if cost.dtype != jnp.float32:
        return f"computes in float32, but cost is {cost.dtype}"
    if cost.shape[1] > _KERNEL_ROWS:
        return f"holds {_KERNEL_ROWS} rows at most, but cost has {cost.shape[1]}"
    return ""


@functools.cache
def _kernel():
    # On a CPU Pallas is never imported: it costs time and may be missing there.
    from .gpu_kernel import kernel

    def run(*arguments, alignment):
        plain = functools.partial(scan, alignment=alignment)
        if 0 in arguments[0].shape:
            return plain(*arguments)
        # A GPU that is not CUDA's, or a program compiled for the CPU beside the GPU.
        cuda = functools.partial(kernel, alignment=alignment)
        return jax.lax.platform_dependent(*arguments, cuda=cuda, default=plain)

    return run
