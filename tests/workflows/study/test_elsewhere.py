"""Rewards of a study in the variants of their task."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.audit.scene_reward import Scene, scene_reward
from gril_jax.config.files import load
from gril_jax.workflows.build import setup
from gril_jax.workflows.study import elsewhere
from gril_jax.workflows.study.rewards import TrainedReward

CONFIG = load(
    "magical_suite", ["--task", "move_to_region", "--encoder.width", "8", "--encoder.latent", "4"]
)
VARIANTS = ("demo", "jitter", "color", "layout", "dynamics", "all")


def _reward(seed):
    blank = setup.blank_reward(CONFIG, 21)
    leaves, tree = jax.tree.flatten(blank)
    draw = np.random.default_rng(seed)
    made = [jnp.asarray(0.3 * draw.normal(size=np.shape(x)), jnp.float32) for x in leaves]
    return TrainedReward(jax.tree.unflatten(tree, made), 0.0, None, 21)


def test_each_reward_is_ranked_in_each_variant_as_by_itself():
    asked, rewards = elsewhere.Elsewhere(starts=3, states=40), [_reward(0), _reward(1)]
    found = asked.measure(asked.compile(CONFIG, 2), CONFIG, rewards)
    assert [*found] == [f"{name}_{v}" for v in VARIANTS for name in ("ranks", "best")]
    assert all(len(x) == 2 and 0 <= min(x) <= max(x) <= 1 for x in found.values())
    env = elsewhere._variant(CONFIG, "color")
    states = jax.jit(asked._states(env))(jax.random.key(VARIANTS.index("color")))
    encoder = setup.encoder_config(CONFIG, len(env.classes))
    shares = []
    for scene, success, counted in zip(
        jax.tree.map(np.asarray, _each(states.scene)), states.success, states.counted, strict=True
    ):
        value = jax.vmap(scene_reward(encoder), (None, 0))(rewards[1].params, scene)
        good, bad = (np.asarray(value)[np.asarray(x & counted)] for x in (success, ~success))
        if len(good) and len(bad):
            shares.append((good[:, None] > bad).mean())
    assert found["ranks_color"][1] == pytest.approx(np.mean(shares), abs=1e-4)
    assert found["ranks_color"][0] != found["ranks_color"][1]


def _each(scene):
    return [Scene(*(x[i] for x in scene)) for i in range(len(scene.center))]


def test_a_success_of_the_region_is_the_robot_in_it():
    env = setup.make_env(CONFIG.env, training=False, variant="layout")
    states = jax.jit(elsewhere.Elsewhere(starts=4, states=50)._states(env))(jax.random.key(0))
    robot, region = (states.scene.center[..., i, :] for i in (0, 1))
    inside = (abs(robot - region) <= states.scene.size[..., 1, :] / 2).all(axis=-1)
    np.testing.assert_array_equal(states.success, inside)
    assert 0.05 < np.mean(inside) < 0.9


def test_a_task_that_cannot_put_things_elsewhere_is_left_out():
    assert elsewhere.Elsewhere().asked(CONFIG)
    assert not elsewhere.Elsewhere().asked(load("shoes_in_box"))


def test_every_variant_has_as_many_objects():
    config = load("magical_suite", ["--task", "find_dupe"])
    made = [
        jax.eval_shape(elsewhere._variant(config, name).reset, jax.random.key(0)).objects.center
        for name in ("demo", "countplus", "all")
    ]
    assert len({x.shape for x in made}) == 1


def test_colours_and_shapes_are_counted_from_0_each():
    classes = ["robot", "red region", "blue region", "red star", "blue star", "blue square"]
    kinds = elsewhere._kinds(classes)
    np.testing.assert_array_equal(kinds[:3], 0)
    np.testing.assert_array_equal(kinds[3:], [[0, 0], [1, 0], [1, 1]])
