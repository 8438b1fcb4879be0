"""Temporal cycle-consistency (Dwibedi et al., CVPR 2019), in all forms that XIRL has.

A frame of one video finds its soft nearest neighbour in another video; that neighbour looks back,
and must land at the time it came from. Latents may be of any float type; the result is at least
float32, and values and gradients are finite whatever is put in. Shapes use T and S for frames, Q
for queries and D for the latent.
"""

from typing import Any, Literal, TypedDict, Unpack

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from gril_jax.errors import ConfigError, ShapeError
from gril_jax.types import checked

from .soft_neighbour import (
    check_positive,
    check_videos,
    closeness,
    log_match_weights,
    match_weights,
    prepare,
)

FORMS = ("regression_mse", "regression_mse_var", "regression_huber", "classification")

# A match on one frame alone has variance 0, whose logarithm is not finite. This is the variance
# of a match that gives 1e-4 of its weight to the next frame, in a video of 100 frames.
_LEAST_VARIANCE = 1e-8


class CycleOptions(TypedDict, total=False):
    """Options of temporal cycle-consistency; keyword arguments of every function of it."""

    temperature: Float[Array, ""] | float
    """Of both softmaxes, 1 if left out; large values blur the match over many frames."""
    similarity: Literal["l2", "cosine"]
    """"l2", the default, or "cosine" for the product of the latents."""
    normalize: bool | None
    """Divide the latents by their lengths; squared distances are then not divided by D. If left
    out, "cosine" does and "l2" does not. The published code takes a plain product for "cosine" and
    leaves the lengths to the encoder: that is False."""
    form: Literal["regression_mse", "regression_mse_var", "regression_huber", "classification"]
    """As `cycle_error` has it; "regression_mse" if left out."""
    huber_delta: Float[Array, ""] | float
    """Of "regression_huber", in units of time; 0.1 if left out."""
    variance_weight: Float[Array, ""] | float
    """Of "regression_mse_var"; 0.001 if left out."""
    label_smoothing: Float[Array, ""] | float
    """Of "classification"; 0.1 if left out."""


@checked
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
    - `classification`: cross-entropy in nats of beta against a target. It is
      1 - e + e / (T - 1) at the query's own frame and e / (T - 1) at the others. Here e is
      `label_smoothing`, and T counts the valid frames. (The published target: it adds up to a
      little more than 1.)

    >>> cycle_error(jnp.array([[0.0, 200.0]]), jnp.array([0.0, 0.5]), jnp.array([0])).tolist()
    [0.25]

    Args:
      logits: of each query's match with the frames of its own video; a constant may be added to
        a row.
      times: of those frames.
      home: each query's own frame; frame q for query q if left out.
      valid: False for frames that are padding; they are never matched.
      form: one of `FORMS`; what follows are its parameters, `huber_delta` in units of time.

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


@checked
def cycle_consistency(
    query: Float[Array, "T D"],
    other: Float[Array, "S D"],
    times: Float[Array, "T"],
    query_valid: Bool[Array, "T"] | None = None,
    other_valid: Bool[Array, "S"] | None = None,
    **options: Unpack[CycleOptions],
) -> Float[Array, "T"]:
    """Error of each query frame after its cycle to the other video and back.

    By default the squared error of its time, with a similarity of minus the squared distance
    divided by D and by the temperature, both ways.

    Args:
      query: latents of the video that is asked.
      other: latents of the video that answers.
      times: of the query frames, usually frame index / video length, in [0, 1].
      query_valid: False for padding, which gets value 0 and is never matched.
      other_valid: the same for the other video. If none of it is valid, all values are 0.
      options: `CycleOptions`.

    Returns:
      One value per query frame, not averaged; non-negative but for `regression_mse_var`.

    Raises:
      ShapeError: the arrays do not fit together.
      ConfigError: an option is unknown, or a value known at trace time is not positive.
    """
    matching, knobs = resolved(**options)
    check_videos(query=query, other=other)
    for name, x, video, latents in (
        ("times", times, "query", query),
        ("query_valid", query_valid, "query", query),
        ("other_valid", other_valid, "other", other),
    ):
        if x is not None and x.shape != latents.shape[:1]:
            raise ShapeError(
                f"{name} has shape {x.shape} but {video} has {latents.shape[0]} frames."
            )
    query = prepare(query, query_valid, unit=matching["unit"])
    other = prepare(other, other_valid, unit=matching["unit"])
    return prepared_cycle(query, other, times, query_valid, other_valid, matching, knobs)


def prepared_cycle(query, other, times, query_valid, other_valid, matching, form):
    """`cycle_consistency` for prepared latents."""
    there = match_weights(closeness(query, other, **matching), other_valid)
    neighbour = jnp.matmul(there, other, precision="highest")
    back = closeness(neighbour, query, **matching)
    error = cycle_error(back, times, valid=query_valid, **form)
    return _counted(error, query_valid, other_valid)


def prepared_agreement(query, other, times, other_times, query_valid, other_valid, matching):
    """Squared difference between each prepared frame's time and its soft neighbour's."""
    if query_valid is not None:
        times = jnp.where(query_valid, times, 0.0)
    if other_valid is not None:
        other_times = jnp.where(other_valid, other_times, 0.0)
    there = match_weights(closeness(query, other, **matching), other_valid)
    arrival = jnp.matmul(there, other_times, precision="highest")
    return _counted(jnp.square(arrival - times), query_valid, other_valid)


def resolved(
    *, temperature=1.0, similarity="l2", normalize=None, **form
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Of `CycleOptions` those of `closeness`, checked, and those of `cycle_error`."""
    check_positive("temperature", temperature)
    unit = similarity == "cosine" if normalize is None else normalize
    return {"temperature": temperature, "similarity": similarity, "unit": unit}, form


def _counted(error, query_valid, other_valid):
    if query_valid is not None:
        error = jnp.where(query_valid, error, 0.0)
    if other_valid is not None:
        error = jnp.where(jnp.any(other_valid), error, 0.0)
    return error


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
