"""Cost matrix of an alignment: distance of each frame of one sequence to each of another.

Shapes use T and S for frames and D for features; leading axes are a batch.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from gril_jax.errors import ShapeError

from .problem import Lengths, spread


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
    origin = jax.lax.stop_gradient(query[..., :1, :].astype(dtype))
    moved = []
    for sequence, count in ((query, lengths), (other, other_lengths)):
        frames = sequence.astype(dtype) - origin
        if count is not None:
            count = spread(count, sequence.shape[-2], sequence.shape[:-2])
            counts = jnp.arange(sequence.shape[-2]) < count[..., None]
            frames = jnp.where(counts[..., None], frames, 0.0)
        moved.append(frames)
    query, other = moved
    products = jnp.einsum("...td,...sd->...ts", query, other, precision="highest")
    squares, other_squares = (jnp.sum(jnp.square(x), axis=-1) for x in (query, other))
    return jnp.maximum(squares[..., :, None] + other_squares[..., None, :] - 2.0 * products, 0.0)
