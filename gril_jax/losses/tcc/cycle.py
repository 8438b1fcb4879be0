"""Temporal cycle-consistency (Dwibedi et al., CVPR 2019), in all forms that XIRL has.

    errors = cycle_consistency(query, other, times)
    errors = cycle_consistency(query, other, times, form="classification", similarity="cosine")

A frame of one video finds its soft nearest neighbour in another video; that neighbour looks
back, and must land at the time it came from. Only the order of events is needed: no actions, no
labels. Shapes use T and S for frames and D for the latent; for the loss of a batch of videos see
`gril_jax.losses.tcc.batch`. Latents may be of any
float type; the result is at least float32. Latents beyond 1e7 count as 1e7 and temperatures
below 1e-6 as 1e-6, so that values and gradients are finite whatever is put in.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from gril_jax.errors import ShapeError

from .forms import cycle_error
from .soft_neighbour import check_positive, check_videos, closeness, match_weights, prepare


def frame_times(
    frames: Int[Array, "*batch T"], length: Int[Array, "*batch"]
) -> Float[Array, "*batch T"]:
    """Times of frames as shares of their video: frame index / length (normalised indices).

    For the published losses on raw indices, give `frames.astype(float)` as times instead.

    >>> frame_times(jnp.array([0, 3]), jnp.array(12)).tolist()
    [0.0, 0.25]
    """
    return frames / jnp.maximum(length, 1)[..., None]


def cycle_consistency(
    query: Float[Array, "T D"],
    other: Float[Array, "S D"],
    times: Float[Array, "T"],
    query_valid: Bool[Array, "T"] | None = None,
    other_valid: Bool[Array, "S"] | None = None,
    *,
    temperature: Float[Array, ""] | float = 1.0,
    similarity: str = "l2",
    normalize: bool | None = None,
    **form: str | Float[Array, ""] | float,
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
      temperature: of both softmaxes; large values blur the match over many frames.
      similarity: "l2", or "cosine" for the product of the latents.
      normalize: divide the latents by their lengths; squared distances are then not divided by
        D. If left out, "cosine" does and "l2" does not. The published code takes a plain
        product for "cosine" and leaves the lengths to the encoder: that is False.
      **form: `form` and its knobs, see `gril_jax.losses.tcc.forms.cycle_error`.

    Returns:
      One value per query frame, not averaged; non-negative but for `regression_mse_var`.

    Raises:
      ShapeError: the arrays do not fit together.
      ConfigError: an option is unknown, or a value known at trace time is not positive.
    """
    _check_pair(query, other, times, query_valid, other_valid)
    matching = matching_options(temperature, similarity, normalize)
    query = prepare(query, query_valid, unit=matching["unit"])
    other = prepare(other, other_valid, unit=matching["unit"])
    return prepared_cycle(query, other, times, query_valid, other_valid, matching, form)


def time_agreement(
    query: Float[Array, "T D"],
    other: Float[Array, "S D"],
    times: Float[Array, "T"],
    other_times: Float[Array, "S"],
    query_valid: Bool[Array, "T"] | None = None,
    other_valid: Bool[Array, "S"] | None = None,
    *,
    temperature: Float[Array, ""] | float = 1.0,
    similarity: str = "l2",
    normalize: bool | None = None,
) -> Float[Array, "T"]:
    """Squared difference between each query frame's time and its soft neighbour's.

    A cycle closes just as well if two videos agree on a scrambled order of events, and training
    does get stuck there. This term knows which way time runs; it is for the first updates only,
    since it also punishes a demonstrator who takes longer over one stage.

    Args, returns and errors as for `cycle_consistency`, with the times of the other video's
    frames too.
    """
    _check_pair(query, other, times, query_valid, other_valid)
    if other_times.shape != other.shape[:1]:
        raise ShapeError(
            f"other_times has shape {other_times.shape} but other has {other.shape[0]} frames."
        )
    matching = matching_options(temperature, similarity, normalize)
    query = prepare(query, query_valid, unit=matching["unit"])
    other = prepare(other, other_valid, unit=matching["unit"])
    return prepared_agreement(query, other, times, other_times, query_valid, other_valid, matching)


def prepared_cycle(query, other, times, query_valid, other_valid, matching, form):
    """`cycle_consistency` for prepared latents."""
    there = match_weights(closeness(query, other, **matching), other_valid)
    neighbour = jnp.matmul(there, other, precision="highest")
    back = closeness(neighbour, query, **matching)
    error = cycle_error(back, times, valid=query_valid, **form)
    return _counted(error, query_valid, other_valid)


def prepared_agreement(query, other, times, other_times, query_valid, other_valid, matching):
    """`time_agreement` for prepared latents."""
    if query_valid is not None:
        times = jnp.where(query_valid, times, 0.0)
    if other_valid is not None:
        other_times = jnp.where(other_valid, other_times, 0.0)
    there = match_weights(closeness(query, other, **matching), other_valid)
    arrival = jnp.matmul(there, other_times, precision="highest")
    return _counted(jnp.square(arrival - times), query_valid, other_valid)


def matching_options(temperature, similarity, normalize):
    check_positive("temperature", temperature)
    unit = similarity == "cosine" if normalize is None else normalize
    return {"temperature": temperature, "similarity": similarity, "unit": unit}


def _counted(error, query_valid, other_valid):
    if query_valid is not None:
        error = jnp.where(query_valid, error, 0.0)
    if other_valid is not None:
        error = jnp.where(jnp.any(other_valid), error, 0.0)
    return error


def _check_pair(query, other, times, query_valid, other_valid):
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
