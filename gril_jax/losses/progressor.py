"""PROGRESSOR (Ayalew et al., ICCV 2025, arXiv 2411.17764): a Gaussian of progress between frames.

Of three frames i <= j <= g of a video, the network predicts a normal distribution of the progress
of j. The target has the mean |j - i| / |g - i| and the deviation max(1 / |g - i|, epsilon). The
loss is the divergence KL(target || predicted). The reward is the mean minus 0.4 times the entropy.
Here frame i is the mean latent of first frames, and frame g that of last ones.

The published method also lowers the mean on a policy's own frames while the policy learns
(push-back). That is not here: rewards are not trained while policies are.

Shapes use F for frames, which is also the number of triplets, D for the latent, three for 3 D, and
H for the width of the hidden layer. epsilon is not published; here it is 0.001.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from . import heads
from .heads import Clip

_WIDTH = 64
_LEAST = 1e-3  # epsilon, of the target's deviation
_ENTROPY = 0.4  # alpha, the weight of the entropy in the reward


class PROGRESSOR(NamedTuple):
    """A network with one hidden layer on three latents side by side."""

    hidden: Float[Array, "three H"]
    hidden_bias: Float[Array, "H"]
    out: Float[Array, "H 2"]
    out_bias: Float[Array, "2"]

    @classmethod
    def init(cls, key: PRNGKeyArray, latent: int) -> "PROGRESSOR":
        """Initial parameters. The key is consumed."""
        hidden, out = jax.random.split(key)
        layers = heads.kernel(hidden, 3 * latent, _WIDTH), heads.kernel(out, _WIDTH, 2)
        return cls(layers[0], jnp.zeros(_WIDTH), layers[1], jnp.zeros(2))

    def loss(self, key: PRNGKeyArray, clip: Clip) -> Float[Array, ""]:
        """The mean divergence of random triplets."""
        return self.divergence(clip, *triplets(key, clip))

    def divergence(
        self, clip: Clip, chosen: Int[Array, "F 3"], counted: Bool[Array, "F"]
    ) -> Float[Array, ""]:
        """The mean divergence of the counted triplets, which are places in the clip."""
        first, frame, last = (clip.frames[chosen[:, i]] for i in range(3))
        span = jnp.maximum(last - first, 1).astype(jnp.float32)
        mean, log_deviation = self.predicted(*(clip.latents[chosen[:, i]] for i in range(3)))
        deviation = jnp.maximum(1.0 / span, _LEAST)
        error = jnp.square(deviation) + jnp.square((frame - first) / span - mean)
        value = log_deviation - jnp.log(deviation) - 0.5
        value = value + error / (2.0 * jnp.exp(2.0 * log_deviation))
        return jnp.sum(jnp.where(counted, value, 0.0)) / jnp.maximum(jnp.sum(counted), 1)

    def predicted(
        self,
        first: Float[Array, "*#batch D"],
        frame: Float[Array, "*#batch D"],
        last: Float[Array, "*#batch D"],
    ) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
        """The mean, and the logarithm of the standard deviation."""
        side_by_side = jnp.concatenate(jnp.broadcast_arrays(first, frame, last), axis=-1)
        hidden = jax.nn.relu(side_by_side @ self.hidden + self.hidden_bias)
        out = hidden @ self.out + self.out_bias
        return out[..., 0], out[..., 1]

    def progress(
        self, latent: Float[Array, "*batch D"], start: Float[Array, "D"], goal: Float[Array, "D"]
    ) -> Float[Array, "*batch"]:
        """The published reward: the mean minus alpha times the entropy."""
        mean, log_deviation = self.predicted(start, latent, goal)
        entropy = 0.5 * jnp.log(2.0 * jnp.pi * jnp.e) + log_deviation
        return mean - _ENTROPY * entropy


def triplets(key: PRNGKeyArray, clip: Clip) -> tuple[Int[Array, "F 3"], Bool[Array, "F"]]:
    """Places of random valid frames in order of time, and True where the outer ones differ.

    The key is consumed."""
    count = len(clip.frames)
    some = jax.random.categorical(key, jnp.where(clip.valid, 0.0, -jnp.inf), shape=(count, 3))
    order = jnp.argsort(clip.frames[some], axis=1)
    some = jnp.take_along_axis(some, order, axis=1)
    return some, clip.frames[some[:, 0]] < clip.frames[some[:, 2]]
