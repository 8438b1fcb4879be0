"""Cycle losses: error of a query frame after its cycle, in the published forms.

The forms are those of XIRL (Zakka et al., CoRL 2021), after Dwibedi et al. (CVPR 2019). Each
turns the logits of the way back into one value for each query. Shapes use Q for queries and T
for the frames of the video they started from.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from gril_jax.errors import ConfigError, ShapeError

from .soft_neighbour import check_positive, log_match_weights, match_weights

FORMS = ("regression_mse", "regression_mse_var", "regression_huber", "classification")

# A match on one frame alone has variance 0, whose logarithm is not finite. This is the variance
# of a match that gives 1e-4 of its weight to the next frame, in a video of 100 frames.
_LEAST_VARIANCE = 1e-8


def cycle_error(
    logits: Float[Array, "Q T"],
    times: Float[Array, "T"],
    home: Int[Array, "Q"] | None = None,
    valid: Bool[Array, "T"] | None = None,
    *,
    form: str = "regression_mse",
    huber_delta: Float[Array, ""] | float = 0.1,
    variance_weight: Float[Array, ""] | float = 0.001,
    label_smoothing: Float[Array, ""] | float = 0.1,
) -> Float[Array, "Q"]:
    """Error of each query after its cycle, not averaged.

    With beta the softmax of a query's logits, s the times, t the time of its own frame, and
    m = sum beta s:

    - `regression_mse`: (m - t)^2.
    - `regression_mse_var`: (m - t)^2 / v + `variance_weight` log v, where v is the variance of s
      under beta. Variances below 1e-8 count as 1e-8.
    - `regression_huber`: (m - t)^2 / 2 within `huber_delta` of t, and
      `huber_delta` (|m - t| - `huber_delta` / 2) beyond.
    - `classification`: cross-entropy in nats of beta against a target of 1 - e + e / (T - 1) at
      the query's own frame and e / (T - 1) at the others, where e is `label_smoothing` and T
      counts the valid frames. (The published target: it adds up to a little more than 1.)

    >>> cycle_error(jnp.array([[0.0, 200.0]]), jnp.array([0.0, 0.5]), jnp.array([0])).tolist()
    [0.25]

    Args:
      logits: of each query's match with the frames of its own video; a constant may be added to
        a row.
      times: of those frames.
      home: each query's own frame; frame q for query q if left out.
      valid: False for frames that are padding; they are never matched.
      form: one of `FORMS`.
      huber_delta: where Huber's error turns linear, in units of time.
      variance_weight: of the logarithm of the variance.
      label_smoothing: e above, in [0, 1].

    Raises:
      ShapeError: `home` is left out, but there is not one query for each frame.
      ConfigError: the form is unknown, or `huber_delta` is known and not positive.
    """
    if form not in FORMS:
        raise ConfigError(f"form is {form!r}; it must be one of {', '.join(FORMS)}.")
    check_positive("huber_delta", huber_delta)
    if home is None and logits.shape[0] != logits.shape[1]:
        raise ShapeError(
            f"logits has shape {logits.shape}; without home there must be a query for each frame."
        )
    if valid is not None:
        times = jnp.where(valid, times, 0.0)
    if form == "classification":
        return _cross_entropy(logits, home, valid, label_smoothing)

    weights = match_weights(logits, valid)
    predicted = jnp.matmul(weights, times, precision="highest")
    error = predicted - (times if home is None else times[home])
    if form == "regression_mse":
        return jnp.square(error)
    if form == "regression_huber":
        size = jnp.abs(error)
        linear = huber_delta * (size - 0.5 * huber_delta)
        return jnp.where(size <= huber_delta, 0.5 * jnp.square(error), linear)
    variance = jnp.sum(weights * jnp.square(times - predicted[:, None]), axis=-1)
    variance = jnp.maximum(variance, _LEAST_VARIANCE)
    return jnp.square(error) / variance + variance_weight * jnp.log(variance)


def _cross_entropy(logits, home, valid, smoothing):
    """Cross-entropy by masked sums: a gather's gradient is a scatter, which is slow on CPU."""
    num_queries, num_frames = logits.shape
    frames = jnp.arange(num_frames)
    home = jnp.arange(num_queries) if home is None else home
    log_weights = log_match_weights(logits, valid)
    others = max(num_frames - 1, 1)
    if valid is not None:
        log_weights = jnp.where(valid, log_weights, 0.0)
        others = jnp.maximum(jnp.sum(valid) - 1, 1)
    at_home = jnp.sum(jnp.where(home[:, None] == frames, log_weights, 0.0), axis=-1)
    return -(1.0 - smoothing) * at_home - smoothing / others * jnp.sum(log_weights, axis=-1)
