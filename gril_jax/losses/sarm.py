"""SARM (Chen et al., arXiv 2509.25358; LeRobot 0.6): the stage, and the progress within it.

Of each frame the target is k + tau: the stage k, by cross-entropy, and the share tau of the stage
that is over, by its squared error. Progress is that of the most likely stage (Formula 2):

    P_(k-1) + alpha_k tau,      P_k = alpha_0 + ... + alpha_k

where alpha_k is the mean share of stage k in the videos. The published network has two transformers
over nine frames, of which the second is told the stage: in three of four updates the true one.
Here both are linear layers on one latent, and the second has a column for each stage, of which the
true one learns. Shapes use F for frames, D for the latent and M for stages.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from gril_jax.subtasks import MOST

from . import heads
from .heads import Clip

_NEVER = -1e9  # logit of a stage that there is not


class SARM(NamedTuple):
    """Linear layers: one for the stage, one with the progress in each stage."""

    stage: Float[Array, "D M"]
    stage_bias: Float[Array, "M"]
    share: Float[Array, "D M"]
    share_bias: Float[Array, "M"]
    proportions: Float[Array, "M"]  # alpha; 0 for stages that there are not. It is not trained.

    @classmethod
    def init(cls, key: PRNGKeyArray, latent: int) -> "SARM":
        """Initial parameters, with a single stage. The key is consumed."""
        stage, share = (heads.kernel(one, latent, MOST) for one in jax.random.split(key))
        zeros = jnp.zeros(MOST)
        return cls(stage, zeros, share, zeros, zeros.at[0].set(1.0))

    def loss(self, key: PRNGKeyArray, clip: Clip) -> Float[Array, ""]:
        """The mean over frames of cross-entropy plus squared error; the key is not used.

        A clip's `stages` are the targets; the end of the last stage belongs to it.
        """
        del key
        last = jnp.max(jnp.where(self.proportions > 0, jnp.arange(MOST), 0))
        stage = jnp.clip(clip.stages.astype(jnp.int32), 0, last)
        chance = jnp.take_along_axis(self._log_chance(clip.latents), stage[:, None], axis=1)[:, 0]
        share = jnp.take_along_axis(self._share(clip.latents), stage[:, None], axis=1)[:, 0]
        error = jnp.square(share - (clip.stages - stage))
        return jnp.mean(error - chance, where=clip.valid)

    def progress(
        self, latent: Float[Array, "*batch D"], start: Float[Array, "D"], goal: Float[Array, "D"]
    ) -> Float[Array, "*batch"]:
        """The predicted progress, as a share of the task."""
        del start, goal
        stage = jnp.argmax(self._log_chance(latent), axis=-1)
        share = jnp.take_along_axis(self._share(latent), stage[..., None], axis=-1)[..., 0]
        before = jnp.cumsum(self.proportions) - self.proportions
        return before[stage] + self.proportions[stage] * share

    def _log_chance(self, latent):
        logits = latent @ self.stage + self.stage_bias
        return jax.nn.log_softmax(jnp.where(self.proportions > 0, logits, _NEVER))

    def _share(self, latent):
        return jax.nn.sigmoid(latent @ self.share + self.share_bias)
