"""A reward as a function of one state."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.audit_tasks import START, start
from support.saved_rewards import CONFIGS, made

from gril_jax.audit.scene_reward import activity_bits, scene_reward
from gril_jax.errors import ConfigError
from gril_jax.reward.learned_reward import LearnedReward


@pytest.mark.parametrize(
    "kind", ["paper", "ensemble", pytest.param("history", marks=pytest.mark.slow)]
)
def test_it_is_the_learned_reward(kind):
    config = CONFIGS[kind]
    scene = start()._replace(label=jnp.array([1, 2, 2, 3, 0]))
    learned = LearnedReward(made(config), config, ("goal", "robot", "star", "square"))
    boxes = scene.center, scene.size
    if kind == "history":
        boxes = (jnp.stack([x] * 3) for x in boxes)
    wanted = learned(*boxes, scene.active, label=scene.label, is_robot=scene.is_robot)
    found = scene_reward(config)(made(config), scene)
    np.testing.assert_allclose(found, wanted, rtol=1e-6)


def test_a_latent_that_is_not_finite_is_no_reward():
    config = CONFIGS["paper"]
    scene, params = start()._replace(label=jnp.zeros(5, jnp.int32)), made(config)
    reward = jax.jit(scene_reward(config))
    assert jnp.isfinite(reward(params, scene))
    assert jnp.isnan(reward(params._replace(goal=params.goal.at[0].set(jnp.nan)), scene))
    broken = params._replace(encoder=jax.tree.map(lambda x: x * jnp.inf, params.encoder))
    assert jnp.isnan(reward(broken, scene))


def test_pictures_are_refused():
    with pytest.raises(ConfigError, match="PixelConfig; it must take boxes"):
        scene_reward(CONFIGS["pixel"])


def test_bits_are_of_what_has_moved_and_then_of_the_robot():
    assert activity_bits(start(), START).tolist() == [False] * 5
    moved = START.at[3, 1].add(0.01)
    assert activity_bits(start(), moved).tolist() == [True, False, False, True, False]
