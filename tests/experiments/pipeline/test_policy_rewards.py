"""Parameters that a policy's reward gets from the demonstrations."""

import dataclasses

import jax.numpy as jnp
import numpy as np
from gril_jax.experiments.pipeline import policy_rewards
from support.kinematic_demos import kinematic_demos

from gril_jax.config import RunConfig, RunSettings
from gril_jax.reward.latent_goal import RewardParams

FRAMES = 140
ENDS = (35, 75, 115)


def _latents(num):
    """A number that falls from 3 to 0 in three steps, each demonstration a little later."""
    frames = np.arange(FRAMES) - 2 * np.arange(num)[:, None]
    return 3 - sum(np.clip((frames - end + 12) / 12, 0, 1) for end in ENDS)


def test_a_chain_has_the_goals_on_which_demonstrations_agree(monkeypatch):
    latents = _latents(6)
    latents[0] -= 0.5 * (np.arange(FRAMES) > 50) * (np.arange(FRAMES) < 56)  # one is hasty
    latents = jnp.asarray(latents[..., None], jnp.float32)
    monkeypatch.setattr(policy_rewards.pretrain, "embed", lambda *_: latents)
    config = RunConfig(run=dataclasses.replace(RunSettings(), reward="subtasks"))
    learned = RewardParams({}, jnp.zeros(1), jnp.float32(1 / 3), jnp.float32(1.0))
    demos = kinematic_demos(0, 6, num_objects=4, max_length=20)
    demos = demos._replace(length=jnp.full(6, FRAMES))
    _, chain = policy_rewards.parameters(config, learned, demos, 4)
    assert int(chain.count) == 3
    assert chain.goals.shape == (8, 1)
    np.testing.assert_allclose(chain.goals[:3, 0], [2, 1, 0], atol=0.1)
    np.testing.assert_allclose(chain.scale[:3], 1, rtol=0.1)  # each step is one long
    assert np.isfinite(np.asarray(chain.radius)).all()
