"""Soft nearest neighbours between videos: latents -> logits -> weights.

Every form of temporal cycle-consistency is built from these. Shapes use Q for queries, S for the
frames that they are compared with and D for the latent.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from gril_jax.errors import ConfigError, ShapeError
from gril_jax.graphs.scene import safe_norm

# Logit of a frame that does not count, once the best frame that counts has 0. Finite, so that a
# video without any valid frame gives uniform weights and zero gradients where -inf gives NaN.
_HIDDEN = -1e9

# Ranges in which squares, their quotients and products of two such gradients fit into float32.
_LARGEST = 1e7
_SMALLEST_TEMPERATURE = 1e-6
_SHORTEST = 1e-7  # a latent below this length has no direction


def check_positive(name: str, value: Array | float) -> None:
    """Raises ConfigError if a value is known at trace time and is not above 0."""
    if isinstance(value, jax.core.Tracer):
        return
    if isinstance(value, str) or not float(value) > 0:
        raise ConfigError(f"{name} is {value}; it must be positive.")


def check_videos(**latents: Float[Array, "..."]) -> None:
    """Raises ShapeError unless all are (frames, D) with the same D, and at least one frame."""
    shapes = {name: x.shape for name, x in latents.items()}
    words = " and ".join(f"{name} has shape {shape}" for name, shape in shapes.items())
    if any(len(shape) != 2 for shape in shapes.values()):
        raise ShapeError(f"{words}; latents of one video must be (frames, D).")
    if any(0 in shape for shape in shapes.values()):
        raise ShapeError(f"{words}; a video needs at least one frame and one latent number.")
    if len({shape[1] for shape in shapes.values()}) > 1:
        raise ShapeError(f"{words}; their last axes must be equal.")


def check_batch(
    latents: Float[Array, "..."], times: Float[Array, "..."], valid: Bool[Array, "..."] | None
) -> None:
    """Raises ShapeError unless latents are (videos, frames, D), and the others fit them."""
    if latents.ndim != 3 or 0 in latents.shape:
        raise ShapeError(
            f"latents has shape {latents.shape}; it must be (videos, frames, D), each at least 1."
        )
    for name, x in (("times", times), ("valid", valid)):
        if x is not None and x.shape != latents.shape[:2]:
            raise ShapeError(
                f"{name} has shape {x.shape} but latents has shape {latents.shape}; "
                f"it must be {latents.shape[:2]}."
            )


def prepare(
    latents: Float[Array, "*batch D"],
    valid: Bool[Array, "*batch"] | None = None,
    *,
    unit: bool = False,
) -> Float[Array, "*batch D"]:
    """Latents made safe to multiply: at least float32, zero in padding, bounded.

    Numbers beyond 1e7 count as 1e7, with gradient zero, so that no square overflows.

    Args:
      latents: of any frames.
      valid: False for padding, which may hold anything, even NaN.
      unit: divide each latent by its length (a zero latent stays zero, with finite gradient).
    """
    latents = latents.astype(jnp.promote_types(latents.dtype, jnp.float32))
    if valid is not None:
        latents = jnp.where(valid[..., None], latents, 0.0)
    latents = jax.lax.clamp(latents.dtype.type(-_LARGEST), latents, latents.dtype.type(_LARGEST))
    if unit:
        latents = latents / jnp.maximum(safe_norm(latents), _SHORTEST)[..., None]
    return latents


def closeness(
    query: Float[Array, "Q D"],
    keys: Float[Array, "S D"],
    *,
    temperature: Float[Array, ""] | float = 1.0,
    similarity: str = "l2",
    unit: bool = False,
) -> Float[Array, "Q S"]:
    """Logits of the match of each query with each key, up to a constant for each query.

    A softmax over the keys cancels that constant, which is the query's own square. Leaving it out
    saves a pass over the largest array. It also keeps digits when latents lie far from zero.

    >>> closeness(jnp.array([[1.0]]), jnp.array([[1.0], [3.0]])).tolist()  # up to a constant
    [[1.0, -3.0]]

    Args:
      query: from `prepare`.
      keys: from `prepare`.
      temperature: divides the logits; values below 1e-6 count as 1e-6.
      similarity: "l2" is minus the squared distance, "cosine" the product.
      unit: the latents have length 1; if not, squared distances are divided by D.
    """
    scores = jnp.matmul(query, keys.T, precision="highest")
    scale = jnp.maximum(temperature, _SMALLEST_TEMPERATURE)
    if similarity == "l2":
        scores = 2.0 * scores - jnp.sum(jnp.square(keys), axis=-1)
        scale = scale if unit else keys.shape[-1] * scale
    elif similarity != "cosine":
        raise ConfigError(f'similarity is {similarity!r}; it must be "l2" or "cosine".')
    return scores / scale


def match_weights(
    logits: Float[Array, "*batch S"], valid: Bool[Array, "*batch S"] | Bool[Array, "S"] | None
) -> Float[Array, "*batch S"]:
    """Softmax over the valid keys; uniform over all if none is valid."""
    return _softmax(_hide(logits, valid))


def log_match_weights(
    logits: Float[Array, "*batch S"], valid: Bool[Array, "*batch S"] | Bool[Array, "S"] | None
) -> Float[Array, "*batch S"]:
    """Logarithm of `match_weights`, exact where the weights themselves would vanish."""
    shifted, total = _shifted(_hide(logits, valid))
    return shifted - jnp.log(total)


@jax.custom_jvp
def _softmax(logits):
    shifted, total = _shifted(logits)
    return jnp.exp(shifted) / total


@_softmax.defjvp
def _softmax_jvp(primals, tangents):
    weights = _softmax(*primals)
    change = weights * tangents[0]
    return weights, change - weights * jnp.sum(change, axis=-1, keepdims=True)


def _shifted(logits):
    """Logits minus their maximum, and the sum of their exponentials.

    A compiler may compute large logits twice, once with fused rounding, and so find some above
    their own maximum: `jax.nn.softmax` then overflows to NaN. Hence both bounds.
    """
    best = jax.lax.stop_gradient(jnp.max(logits, axis=-1, keepdims=True))
    shifted = logits - best
    shifted = jnp.where(shifted > 0, 0.0, shifted)
    total = jnp.sum(jnp.exp(shifted), axis=-1, keepdims=True)
    return shifted, jnp.maximum(total, jnp.finfo(total.dtype).tiny)


def _hide(logits, valid):
    """Masks logits so that padding cannot win, however low those of valid frames are."""
    if valid is None:
        return logits
    best = jnp.max(logits, axis=-1, keepdims=True, where=valid, initial=-jnp.inf)
    best = jax.lax.stop_gradient(jnp.where(jnp.isfinite(best), best, 0.0))
    return jnp.where(valid, logits - best, _HIDDEN)
