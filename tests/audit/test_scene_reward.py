"""A reward as a function of one state."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.audit_tasks import START, one_shoe, packing, start
from support.saved_rewards import CONFIGS, made

from gril_jax.audit.scene_reward import activity_bits, alone, grid, pushed, scene_reward
from gril_jax.errors import ConfigError
from gril_jax.reward.learned_reward import LearnedReward


@pytest.mark.parametrize("kind", ["paper", "ensemble"])
def test_it_is_the_learned_reward(kind):
    config = CONFIGS[kind]
    scene = start()._replace(label=jnp.array([1, 2, 2, 3, 0]))
    learned = LearnedReward(made(config), config, ("goal", "robot", "star", "square"))
    boxes = scene.center, scene.size
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


def test_rows_go_up_and_columns_to_the_right():
    places = grid(2.0, 3)
    np.testing.assert_allclose(places[0, 0], [-2, -2])
    np.testing.assert_allclose(places[0, 2], [2, -2])
    np.testing.assert_allclose(places[2, 0], [-2, 2])


def test_each_object_alone_goes_from_wall_to_wall():
    task, center = one_shoe(), START.at[3].set(0.0)
    scenes = alone(task, start(), center, side=3)
    assert scenes.center.shape == (5, 3, 3, 5, 2)
    for m, index in enumerate((1, 2, 3, 4, 0)):
        np.testing.assert_allclose(scenes.center[m, 0, 2, index], [0.9, -0.9], atol=1e-6)
        rest = np.delete(np.arange(5), index)
        np.testing.assert_array_equal(scenes.center[m, 1, 1, rest], center[rest])
        assert scenes.active[m, 0, 0, index]
        assert scenes.active[m, 0, 0, 3]  # it is not where it began
    assert scenes.size.shape == scenes.center.shape


def test_all_targets_are_pushed_side_by_side():
    scenes = pushed(packing(), start(), side=5)
    targets = jnp.array([1, 2, 3])
    np.testing.assert_allclose(
        scenes.center[2, 2, targets], [[-0.2, 0], [0, 0], [0.2, 0]], atol=1e-6
    )
    assert (jnp.abs(scenes.center[:, :, targets]) <= 0.9 + 1e-6).all()
    np.testing.assert_array_equal(scenes.center[1, 1, 4], START[4])
