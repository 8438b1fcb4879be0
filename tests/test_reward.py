"""The learned reward: goal, scale, sign, and its gradient at the goal."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax import activity, encoder, reward
from gril_jax.encoder import EncoderConfig
from gril_jax.graphs import scene_graph
from gril_jax.types import DemoBatch

CONFIG = EncoderConfig(num_classes=4, width=8, rounds=1, latent=5)
apply, value_of = jax.jit(encoder.apply), jax.jit(reward.latent_goal_reward)
PARAMS = jax.jit(encoder.init)(jax.random.key(0), CONFIG)


def _demos(num_demos=3, num_frames=6, num_nodes=4):
    rng = np.random.default_rng(0)
    length = jnp.array([6, 4, 5])[:num_demos]
    center = rng.normal(size=(num_demos, num_frames, num_nodes, 2)).astype(np.float32)
    center[:, :, 0] = center[:, :1, 0]  # one object never moves

    def tile(x):
        return jnp.broadcast_to(x, (num_demos, *x.shape))

    return DemoBatch(
        center=jnp.asarray(center),
        size=jnp.full((num_demos, num_frames, num_nodes, 2), 0.3),
        label=tile(jnp.arange(num_nodes)),
        is_robot=tile(jnp.arange(num_nodes) == 1),
        present=tile(jnp.arange(num_nodes) != 3),
        length=length,
    )


def _graph(demos, demo, frame, window=40):
    active = activity.trajectory(demos.center[demo], demos.size[demo], window=window)
    return scene_graph(
        demos.center[demo, frame],
        demos.size[demo, frame],
        demos.label[demo],
        demos.is_robot[demo],
        active[frame],
        demos.present[demo],
    )


def _latent(demos, demo, frame, alpha=5.0):
    return apply(PARAMS, _graph(demos, demo, frame), CONFIG, alpha=alpha)


@pytest.mark.parametrize("alpha", [1.0, 5.0])
def test_goal_is_the_mean_last_latent_and_scale_the_inverse_mean_first_distance(alpha):
    demos = _demos()
    params = reward.from_demos(PARAMS, demos, CONFIG, alpha=alpha)
    last = [_latent(demos, i, int(n) - 1, alpha) for i, n in enumerate(demos.length)]
    goal = np.mean(last, axis=0)
    np.testing.assert_allclose(params.goal, goal, rtol=1e-4, atol=1e-5)
    first = [_latent(demos, i, 0, alpha) for i in range(3)]
    distance = np.mean([np.linalg.norm(z - goal) for z in first])
    np.testing.assert_allclose(params.scale, 1 / distance, rtol=1e-4)


def test_reward_is_minus_the_scaled_distance_and_about_minus_one_at_reset():
    demos = _demos()
    params = reward.from_demos(PARAMS, demos, CONFIG)
    values = [value_of(params, _graph(demos, i, 0), CONFIG) for i in range(3)]
    expected = [
        -float(params.scale) * np.linalg.norm(_latent(demos, i, 0) - params.goal) for i in range(3)
    ]
    np.testing.assert_allclose(values, expected, rtol=1e-4)
    np.testing.assert_allclose(np.mean(values), -1.0, rtol=1e-4)
    assert max(values) <= 0


def test_reward_and_its_gradient_are_zero_at_the_goal():
    # The last layer gives its bias whatever it sees, so that rounding cannot miss the goal.
    last = PARAMS["head"]["Dense_1"]
    head = PARAMS["head"] | {"Dense_1": last | {"kernel": jnp.zeros_like(last["kernel"])}}
    params = reward.RewardParams(PARAMS | {"head": head}, last["bias"], jnp.ones(()), jnp.ones(()))
    graph = _graph(_demos(1), 0, 5)
    value, gradient = jax.value_and_grad(value_of)(params, graph, CONFIG)
    assert value == 0
    assert all((x == 0).all() for x in jax.tree.leaves(gradient))


def test_demonstrations_that_begin_at_the_goal_have_scale_one():
    demos = _demos(1)._replace(length=jnp.array([1]))
    params = reward.from_demos(PARAMS, demos, CONFIG)
    assert params.scale == 1
    assert value_of(params, _graph(demos, 0, 0), CONFIG) == 0


def test_frames_after_the_length_change_nothing():
    demos = _demos()
    center = demos.center.at[1, 4:].set(99.0)
    expected = reward.from_demos(PARAMS, demos, CONFIG)
    found = reward.from_demos(PARAMS, demos._replace(center=center), CONFIG)
    np.testing.assert_array_equal(found.goal, expected.goal)
    np.testing.assert_array_equal(found.scale, expected.scale)


def test_vmap_over_seeds_equals_a_loop():
    demos = _demos()
    keys = jax.random.split(jax.random.key(1), 3)
    make = jax.jit(lambda key: reward.from_demos(encoder.init(key, CONFIG), demos, CONFIG))
    many = jax.vmap(make)(keys)
    graph = _graph(demos, 0, 2)
    values = jax.vmap(value_of, (0, None, None))(many, graph, CONFIG)
    for key, value in zip(keys, values, strict=True):
        alone = reward.latent_goal_reward(make(key), graph, CONFIG)
        np.testing.assert_allclose(value, alone, rtol=1e-4, atol=1e-6)
