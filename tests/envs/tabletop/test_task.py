"""Common parts of the tasks on the table: options and the contract of an environment."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.tabletop import boxes as cameras

from gril_jax import envs


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"reward": "dense"}, "reward is 'dense', but must be one of staged"),
        ({"jitter": 1.5}, "jitter is 1.5, but must be between 0 and 1"),
        ({"substeps": 0}, "substeps is 0, but must be at least 1"),
        ({"episode_length": 0}, "episode_length is 0"),
    ],
)
def test_options_out_of_range_are_named(options, words):
    with pytest.raises(ValueError, match=words):
        envs.make("shoes_in_box", **options)


def test_each_number_has_a_name_and_reset_keeps_its_types():
    env = envs.make("shoes_in_box")
    assert isinstance(env, envs.Env)
    first = jax.eval_shape(env.reset, jax.random.key(0))
    assert first.obs.shape == (env.observation_size,) == (len(env.observation_names),)
    assert len(set(env.observation_names)) == env.observation_size
    assert env.action_size == len(env.action_names)
    assert not any(leaf.weak_type for leaf in jax.tree.leaves(first))


@pytest.fixture(scope="module")
def layout():
    """The task and its start without any jitter."""
    env = envs.make("shoes_in_box", jitter=0.0)
    return env, jax.jit(env.reset)(jax.random.key(0))


def test_boxes_in_space_and_in_the_view_are_in_the_order_of_the_classes(layout):
    env, state = layout
    boxes = env.world_boxes(state.data)
    assert boxes.position.shape == (len(env.classes), 3)
    assert state.objects.is_robot.tolist() == [True] * 3 + [False] * 4
    seen = cameras.project(env.camera, boxes)
    np.testing.assert_allclose(state.objects.center, seen[0], atol=1e-5)
    np.testing.assert_allclose(state.objects.size, seen[1], atol=1e-5)
    hand, shoe = env.classes.index("hand"), env.classes.index("shoe B")
    np.testing.assert_allclose(boxes.position[hand, :2], [0.5, 0.05], atol=2e-3)
    np.testing.assert_allclose(boxes.position[shoe], [0.48, 0.27, 0.025], atol=1e-6)
    outlines = env.outlines(state.data)
    assert len(outlines) == len(env.classes)
    assert all((np.abs(outline.vertices) <= env.half_extent).all() for outline in outlines)


def test_observed_places_are_from_the_hand(layout):
    env, state = layout
    seen = dict(zip(env.observation_names, np.asarray(state.obs), strict=True))
    hand = [seen[f"hand {p}"] for p in "xyz"]
    shoe = [seen[f"shoe B {p}"] for p in "xyz"]
    np.testing.assert_allclose(np.add(hand, shoe), [0.48, 0.27, 0.025], atol=1e-6)
    np.testing.assert_allclose([seen[f"hand z axis {p}"] for p in "xyz"], [0, 0, -1], atol=1e-3)
    assert seen["joint 4"] == pytest.approx(-2.2644)
    assert jnp.isfinite(state.obs).all()
