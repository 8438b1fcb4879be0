"""Dynamic time warping, the limit of `soft_dtw` at gamma = 0, with its best alignment.

The same compiled loops as for soft-DTW run here with a plain minimum. Shapes use T and S for
frames; leading axes are a batch.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from gril_jax.errors import ShapeError

from .soft_dtw import best_value, best_value_and_alignment, prepare

Lengths = Int[Array, "..."] | int | None


def dtw(
    cost: Float[Array, "*batch T S"],
    lengths: Lengths = None,
    other_lengths: Lengths = None,
    *,
    band: int | None = None,
) -> Float[Array, "*batch"]:
    """Least sum of costs over all monotone alignments.

    Its derivative by the cost is 1 on the best path and 0 elsewhere. Where several paths are
    equally good this is one of the subgradients: ties go to the diagonal, then up, then left,
    seen from the end. Arguments, safe values and errors are those of `soft_dtw`.

    >>> dtw(jnp.array([[1.0, 9.0], [2.0, 3.0]]))
    Array(4., dtype=float32)
    """
    problem = prepare(cost, lengths, other_lengths, 1.0, band)
    return best_value(*problem, "scan", True).reshape(cost.shape[:-2])


def dtw_path(
    cost: Float[Array, "T S"],
    lengths: Lengths = None,
    other_lengths: Lengths = None,
    *,
    band: int | None = None,
) -> tuple[Float[Array, ""], Int[Array, "P 2"]]:
    """`dtw` of one pair and its best path; batch with `jax.vmap`.

    Returns:
      The least sum, and the path's cells (row, column) in order. A path has from max(T, S) to
      P = T + S - 1 cells; the rows of the answer that are left over hold -1. Where every path is
      forbidden, the value is 1e20 or more.

    Raises:
      ShapeError: `cost` is no matrix, or as for `dtw`.

    >>> dtw_path(jnp.array([[1.0, 9.0], [2.0, 3.0]]))[1].tolist()
    [[0, 0], [1, 1], [-1, -1]]
    """
    if cost.ndim != 2:
        raise ShapeError(f"cost has shape {cost.shape}, but dtw_path takes one pair: (T, S)")
    problem = prepare(cost, lengths, other_lengths, 1.0, band)
    value, alignment = jax.lax.stop_gradient(best_value_and_alignment(*problem, "scan", True))
    # Both indices never fall along a path, so the order by rows is the order along the path.
    most = sum(cost.shape) - 1
    cells = jnp.nonzero(alignment[0] > 0, size=most, fill_value=-1)
    return value[0], jnp.stack(cells, axis=-1)
