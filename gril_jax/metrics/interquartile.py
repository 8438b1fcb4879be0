"""The interquartile mean over seeds, with a bootstrap interval (Agarwal et al., NeurIPS 2021).

    low, high = interquartile_interval(key, success_rates)

The mean of the middle half of the runs: it shrugs off single runs that fail or excel, as a
median does, but uses more of the data. Shapes use R for runs (seeds) and K for tasks.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from gril_jax.errors import ConfigError, ShapeError


def interquartile_mean(scores: Float[Array, "*shape"]) -> Float[Array, ""]:
    """Mean of the scores without the lowest and the highest quarter.

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


def interquartile_interval(
    key: PRNGKeyArray,
    scores: Float[Array, "R"] | Float[Array, "R K"],
    *,
    confidence: Float[Array, ""] | float = 0.95,
    num_resamples: int = 2000,
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Percentile bootstrap interval of the interquartile mean. The key is consumed.

    With several tasks the runs of each are drawn again by themselves (stratified), and the mean
    is over all of them. With few runs the interval is too narrow: five of them cannot show what
    a sixth would do.

    Args:
      key: of the draws.
      scores: one per run, or one per run and task.
      confidence: share of the bootstrap distribution inside the interval.
      num_resamples: how many times the runs are drawn again.

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
