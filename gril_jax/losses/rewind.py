"""ReWiND's progress (Zhang et al., CoRL 2025, arXiv 2505.10911): the share of a video that is over.

Of frame t of T, counted from 1, the target is t / T, and the loss its squared error. The published
network reads the frames so far and an instruction; here the latent of one frame stands for them,
whose activity bits remember what has moved. The other half of the method is its augmentation,
`pretrain.rewind`: part of a video is played backwards, and progress falls.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from . import heads
from .heads import Clip


class ReWiND(NamedTuple):
    """A linear layer below a sigmoid."""

    kernel: Float[Array, "D 1"]
    bias: Float[Array, ""]

    @classmethod
    def init(cls, key: PRNGKeyArray, latent: int) -> "ReWiND":
        """Initial parameters. The key is consumed."""
        return cls(heads.kernel(key, latent, 1), jnp.zeros(()))

    def loss(self, key: PRNGKeyArray, clip: Clip) -> Float[Array, ""]:
        """The mean squared error of the frames' progress; the key is not used."""
        del key
        error = self._predicted(clip.latents) - (clip.frames + 1) / clip.length
        return jnp.mean(jnp.square(error), where=clip.valid)

    def progress(
        self, latent: Float[Array, "*batch D"], start: Float[Array, "D"], goal: Float[Array, "D"]
    ) -> Float[Array, "*batch"]:
        """The predicted share of a video."""
        del start, goal
        return self._predicted(latent)

    def _predicted(self, latent):
        return jax.nn.sigmoid((latent @ self.kernel)[..., 0] + self.bias)
