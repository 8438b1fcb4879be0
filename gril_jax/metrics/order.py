"""Measures of how well a latent or a reward orders the frames of a recording, and means over seeds.

Everything here can be jitted. Shapes use B for recordings, T and S for frames (padded to a common
length) and D for the latent, R for runs (seeds) and K for tasks; `length` counts a recording's
frames before padding.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from gril_jax.errors import ConfigError, ShapeError
from gril_jax.types import checked


@checked
def kendall_tau(
    x: Float[Array, "T"] | Int[Array, "T"], length: Int[Array, ""] | int | None = None
) -> Float[Array, ""]:
    """Kendall's tau-b between a sequence and its own frame indices, in [-1, 1].

    Where tau is undefined (a constant sequence, or fewer than two frames) the value is 0: a
    collapsed latent orders nothing, and must not vanish from a mean as NaN would.

    Args:
      x: values in order of time; ties are allowed.
      length: how many of them count; all if left out.

    Raises:
      ShapeError: `x` has not one axis.
    """
    if x.ndim != 1:
        raise ShapeError(f"x has shape {x.shape}, but must be one value for each frame")
    frame = jnp.arange(x.shape[0])
    counted = frame[:, None] < frame
    if length is not None:
        counted &= frame < length
    order = jnp.where(counted, jnp.sign(x[None, :] - x[:, None]), 0).astype(jnp.float32)
    pairs, untied = jnp.sum(counted), jnp.sum(jnp.abs(order))
    # Frame indices have no ties, so tau-b's denominator is sqrt(all pairs * untied pairs).
    # Roots are taken one by one: their product stays exact enough where n^4 would not fit.
    denominator = jnp.sqrt(pairs.astype(jnp.float32)) * jnp.sqrt(untied)
    return jnp.sum(order) / jnp.where(untied > 0, denominator, 1.0)


@checked
def alignment_tau(
    query: Float[Array, "T D"],
    key: Float[Array, "S D"],
    query_length: Int[Array, ""] | int | None = None,
    key_length: Int[Array, ""] | int | None = None,
) -> Float[Array, ""]:
    """Order in time of one video's nearest neighbours in another, as Kendall's tau (as in XIRL).

    1 if they advance with every query frame, -1 if they run backwards.

    Args:
      query: latents of the video whose frames look for neighbours.
      key: latents of the video they look in.
      query_length: frames of `query` that count; all if left out.
      key_length: the same for `key`.

    Raises:
      ShapeError: a video has not two axes.
    """
    if query.ndim != 2 or key.ndim != 2:
        raise ShapeError(f"query has shape {query.shape} and key {key.shape}; both must be (T, D)")
    distance = jnp.sum(jnp.square(key), axis=-1) - 2.0 * jnp.matmul(
        query, key.T, precision="highest"
    )
    if key_length is not None:
        distance = jnp.where(jnp.arange(key.shape[0]) < key_length, distance, jnp.inf)
    return kendall_tau(jnp.argmin(distance, axis=-1), query_length)


@checked
def mean_alignment_tau(
    latents: Float[Array, "B T D"], length: Int[Array, "B"] | None = None
) -> Float[Array, ""]:
    """Mean of `alignment_tau` over all ordered pairs of different videos; 0 for one video. A
    ShapeError unless the latents have three axes."""
    num_videos, length = len(latents), _lengths(latents, length)

    def from_query(query):  # one row of pairs at a time: memory grows with B T^2, not B^2 T^2
        against_all = jax.vmap(alignment_tau, in_axes=(None, 0, None, 0))
        return against_all(latents[query], latents, length[query], length)

    taus = jax.lax.map(from_query, jnp.arange(num_videos))
    others = ~jnp.eye(num_videos, dtype=bool)
    return jnp.sum(jnp.where(others, taus, 0.0)) / max(num_videos * (num_videos - 1), 1)


@checked
def two_way_cycle_consistency(
    latents: Float[Array, "B T D"], length: Int[Array, "B"] | None = None, *, tolerance: int = 1
) -> Float[Array, ""]:
    """Share of frames that come back from another video, mean over all ordered pairs.

    By hard nearest neighbours (Aytar et al., NeurIPS 2018); XIRL evaluates its latents so.

    >>> twice = jnp.tile(jnp.arange(4.0)[:, None], (2, 1, 1))  # a video and itself
    >>> two_way_cycle_consistency(twice, tolerance=0)
    Array(1., dtype=float32)

    Args:
      latents: of each video's frames.
      length: frames before padding; all if left out.
      tolerance: how many frames off still counts as back.

    Returns:
      In [0, 1]; 0 if there is no pair of videos with at least one frame each.
    """
    length = _lengths(latents, length)
    nearest = _nearest_frames(latents, length)

    def from_query(u):  # to every other video and back
        back = jnp.take_along_axis(nearest[:, u], nearest[u], axis=1)
        frames = jnp.arange(back.shape[-1])
        home = (jnp.abs(back - frames) <= tolerance) & (frames < length[u])
        share = jnp.sum(home, axis=-1).astype(float) / jnp.maximum(length[u], 1).astype(float)
        return share, (length > 0) & (length[u] > 0) & (jnp.arange(len(length)) != u)

    share, counted = jax.lax.map(from_query, jnp.arange(len(length)))
    return jnp.sum(jnp.where(counted, share, 0.0)) / jnp.maximum(jnp.sum(counted), 1).astype(float)


def _nearest_frames(latents, length) -> Int[Array, "B B T"]:
    """Entry (u, v, t) is the frame of v nearest to frame t of u; the first if several are."""
    valid = jnp.arange(latents.shape[1]) < length[:, None]
    keys = jnp.where(valid[..., None], latents, 0.0)
    squares = jnp.sum(jnp.square(keys), axis=-1)

    def pair(query, key, square, valid):
        distance = square - 2.0 * jnp.matmul(query, key.T, precision="highest")
        return jnp.argmin(jnp.where(valid, distance, jnp.inf), axis=-1).astype(jnp.int32)

    def from_query(query):
        return jax.vmap(pair, in_axes=(None, 0, 0, 0))(query, keys, squares, valid)

    return jax.lax.map(from_query, keys)


def _lengths(latents, length) -> Int[Array, "B"]:
    num_videos, num_frames, _ = latents.shape
    return jnp.full(num_videos, num_frames) if length is None else length


@checked
def interquartile_mean(scores: Float[Array, "*shape"]) -> Float[Array, ""]:
    """Mean of the scores without the lowest and the highest quarter (Agarwal et al., NeurIPS 2021).

    It shrugs off single runs that fail or excel, as a median does, but uses more of the data.

    A quarter is rounded down, as in `scipy.stats.trim_mean(scores, 0.25)`: of fewer than four
    scores none is left out. A score that is NaN makes the result NaN.

    >>> float(interquartile_mean(jnp.array([0.0, 1.0, 2.0, 100.0])))
    1.5

    Raises:
      ShapeError: there is no score.
    """
    if not scores.size:
        raise ShapeError(f"scores has shape {scores.shape}; it must hold at least one score.")
    ordered = jnp.sort(scores.ravel())
    cut = ordered.size // 4
    middle = jnp.mean(ordered[cut : ordered.size - cut])
    return jnp.where(jnp.isnan(ordered[-1]), jnp.nan, middle)  # NaN is sorted last, and cut off


@checked
def interquartile_interval(
    key: PRNGKeyArray,
    scores: Float[Array, "R"] | Float[Array, "R K"],
    *,
    confidence: Float[Array, ""] | float = 0.95,
    num_resamples: int = 2000,
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Percentile bootstrap interval of the interquartile mean. The key is consumed.

    With several tasks the runs of each are resampled by themselves (stratified), and the mean
    is over all of them. With few runs the interval is too narrow: five of them cannot show what
    a sixth would do.

    Args:
      key: of the draws.
      scores: one per run, or one per run and task.
      confidence: share of the bootstrap distribution inside the interval.
      num_resamples: how many times the runs are resampled.

    Returns:
      Lower and upper end, in the scores' units; equal if there is one run.

    Raises:
      ShapeError: there is no score.
      ConfigError: `confidence` is known and not inside (0, 1), or there is no resample.
    """
    if not isinstance(confidence, jax.core.Tracer) and not 0 < float(confidence) < 1:
        raise ConfigError(f"confidence is {confidence}; it must be between 0 and 1.")
    if num_resamples < 1:
        raise ConfigError(f"num_resamples is {num_resamples}; it must be at least 1.")
    if scores.ndim not in (1, 2) or not scores.size:
        raise ShapeError(f"scores has shape {scores.shape}; it must be (runs,) or (runs, tasks).")

    def resample(key):
        drawn = jax.random.randint(key, scores.shape, 0, scores.shape[0])
        return interquartile_mean(jnp.take_along_axis(scores, drawn, axis=0))

    means = jax.vmap(resample)(jax.random.split(key, num_resamples))
    tail = (1.0 - confidence) / 2.0
    low, high = jnp.quantile(means, jnp.stack([jnp.asarray(tail), jnp.asarray(1.0 - tail)]))
    return low, high
