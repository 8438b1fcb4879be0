"""Audits of many rewards in one program beside the audit of each by itself."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.audit import measures
from gril_jax.audit.scene_reward import scene_reward
from gril_jax.audit.shortfalls import KINDS
from gril_jax.config import EnvConfig
from gril_jax.encoders import encoder
from gril_jax.errors import ConfigError
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.workflows.study import audit

VARIANTS = ("demo", "layout")
ENV = EnvConfig(targets=("green square",), distractors=("yellow circle",))


def test_a_scene_without_a_demo_start_is_refused():
    stray = EnvConfig(targets=("red star",), distractors=(), variant="layout")
    with pytest.raises(ConfigError, match="env: "):
        audit.audited_tasks(stray, VARIANTS)


@pytest.mark.slow
def test_each_reward_has_the_figures_of_its_own_audit():
    config = encoder.EncoderConfig(7, width=4, rounds=1, latent=3)
    network = jax.vmap(lambda key: encoder.init(key, config))(jax.random.split(jax.random.key(3)))
    each = jnp.ones(2)
    params = RewardParams(network, jnp.ones((2, 3)), each, jnp.array([5.0, 1.0]))
    on = audit.ground(audit.audited_tasks(ENV, VARIANTS), starts=1)
    run = audit.audit_program(config, on.task, ascents=4)
    found = audit.audit_figures(run, params, on)
    assert {x.shape for x in found.values()} == {(2,)}
    second = jax.tree.map(lambda x: x[1], params)
    for variant, states in on.states.items():
        alone = jax.jit(
            lambda p, s, task=on.task: (
                measures.audit(
                    scene_reward(config), p, jax.random.key(0), task, s, ascents=4
                ).measures
            )
        )(second, states)
        for name, field in audit.FIGURES.items():
            mine = found[f"{name}_{variant}"][1]
            np.testing.assert_allclose(mine, getattr(alone, field), rtol=1e-3, atol=1e-4)
        mine = found[f"misranked_just_outside_{variant}"][1]
        np.testing.assert_allclose(mine, alone.misranked[KINDS.index("just outside")], atol=1e-4)
