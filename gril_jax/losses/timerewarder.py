"""TimeRewarder (Liu et al., ICML 2026, arXiv 2509.26627): the time between two frames of a video.

Of frames u and v of a video of T frames the target is d = (v - u) / (T - 1), from -1 to 1, as a
two-hot distribution over 20 bins; the loss is its cross-entropy. The interval |v - u| is sampled in
proportion to its inverse, in both directions. Features of the two frames are concatenated before a
linear layer. The published reward of a step is `distance(latent, next_latent)`, and its potential
is the distance from the first frame, which is `progress` here.

Shapes use F for frames, D for the latent, K for bins, and pair for two latents.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from . import heads
from .heads import Clip

BINS = 20


class TimeRewarder(NamedTuple):
    """The linear layer on a pair of latents."""

    kernel: Float[Array, "pair K"]
    bias: Float[Array, "K"]

    @classmethod
    def init(cls, key: PRNGKeyArray, latent: int) -> "TimeRewarder":
        """Initial parameters. The key is consumed."""
        return cls(heads.kernel(key, 2 * latent, BINS), jnp.zeros(BINS))

    def loss(self, key: PRNGKeyArray, clip: Clip) -> Float[Array, ""]:
        """The cross-entropy that is expected of sampled pairs: over all pairs of the clip, each
        weighted by its probability, so that the key is not used."""
        del key
        interval = clip.frames - clip.frames[:, None]  # of v, along the second axis, after u
        target = two_hot(interval / jnp.maximum(clip.length - 1, 1))
        predicted = jax.nn.log_softmax(self._logits(clip.latents[:, None], clip.latents))
        # An interval is in so many pairs as there are frames less the interval.
        apart = jnp.abs(interval)
        weight = 1.0 / jnp.maximum(apart * (clip.length - apart), 1)
        weight = jnp.where((apart > 0) & clip.valid & clip.valid[:, None], weight, 0.0)
        error = -jnp.sum(target * predicted, axis=-1)
        return jnp.sum(weight * error) / jnp.maximum(jnp.sum(weight), 1e-9)

    def distance(
        self, first: Float[Array, "*#batch D"], second: Float[Array, "*#batch D"]
    ) -> Float[Array, "*batch"]:
        """The predicted time from one frame to another, as a share of a video."""
        chance = jax.nn.softmax(self._logits(first, second))
        return jnp.sum(chance * jnp.linspace(-1.0, 1.0, BINS), axis=-1)

    def progress(
        self, latent: Float[Array, "*batch D"], start: Float[Array, "D"], goal: Float[Array, "D"]
    ) -> Float[Array, "*batch"]:
        """The predicted time since the first frame."""
        del goal
        return self.distance(start, latent)

    def _logits(self, first, second):
        """The layer on both, which may be broadcast: each half of it on one of them."""
        half = first.shape[-1]
        return first @ self.kernel[:half] + second @ self.kernel[half:] + self.bias


def two_hot(x: Float[Array, "*batch"]) -> Float[Array, "*batch K"]:
    """The two nearest of 20 bins from -1 to 1, weighted so that their mean is x.

    >>> jnp.flatnonzero(two_hot(jnp.array(0.0))).tolist()
    [9, 10]
    """
    place = (jnp.clip(x, -1.0, 1.0) + 1.0) / 2 * (BINS - 1)
    away = jnp.abs(place[..., None] - jnp.arange(BINS))
    return jnp.maximum(1.0 - away, 0.0)
