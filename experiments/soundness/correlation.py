"""Rank correlations of an encoder's figures with the success of its policy.

Spearman's rho with a percentile bootstrap over encoders (Efron & Tibshirani, 1993, section 13.3).
Shapes use n for encoders and R for bootstrap samples.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.stats import rankdata


class Correlation(NamedTuple):
    """Correlation of one figure with success; NaN where either is the same for all encoders."""

    rho: float
    low: float  # of the 95 % interval
    high: float
    better: float  # share of bootstrap samples in which the figure predicts better than its rival
    count: int  # encoders with a success


def spearman(
    x: Float[np.ndarray, "*rows n"], y: Float[np.ndarray, "*rows n"]
) -> Float[np.ndarray, "*rows"]:
    """Spearman's rank correlation along the last axis, ties at their mean rank; NaN if constant."""
    x, y = (rankdata(values, axis=-1) for values in (x, y))
    x, y = (ranks - ranks.mean(axis=-1, keepdims=True) for ranks in (x, y))
    scale = np.sqrt((x**2).sum(axis=-1) * (y**2).sum(axis=-1))
    varied = scale > 0
    return np.where(varied, (x * y).sum(axis=-1) / np.where(varied, scale, 1.0), np.nan)


def correlation(
    figure: Float[np.ndarray, "n"],
    success: Float[np.ndarray, "n"],
    rival: Float[np.ndarray, "n"],
    *,
    sign: int = 1,
    draws: int = 4000,
) -> Correlation:
    """A figure's correlation with success, beside that of a rival that should be positive.

    A figure that is undefined, as a share is where success is paid no more than the start,
    ranks as the worst; an encoder without a policy is left out. The sign is 1 where a high
    figure should mean success, and -1 where a low one should; draws are samples of n encoders
    with replacement.
    """
    figure = np.where(np.isnan(figure), -sign * np.inf, figure)
    known = np.isfinite(success) & np.isfinite(rival)
    figure, success, rival = (np.asarray(x, np.float64)[known] for x in (figure, success, rival))
    count = int(known.sum())
    if count < 2:
        return Correlation(np.nan, np.nan, np.nan, np.nan, count)
    rho = float(spearman(figure, success))
    chosen = np.random.default_rng(0).integers(count, size=(draws, count))
    samples = spearman(figure[chosen], success[chosen])
    other = spearman(rival[chosen], success[chosen])
    usual = np.isfinite(samples)  # a sample may have the same encoder throughout
    both = usual & np.isfinite(other)
    if not usual.any():
        return Correlation(np.nan, np.nan, np.nan, np.nan, count)
    low, high = np.quantile(samples[usual], [0.025, 0.975])
    better = float((sign * samples > other)[both].mean()) if both.any() else np.nan
    return Correlation(rho, float(low), float(high), better, count)
