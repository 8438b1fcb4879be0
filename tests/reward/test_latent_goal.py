"""The learned reward: goal, scale, sign, and its gradient at the goal."""

import functools
import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax import reward
from gril_jax.encoders import encoder
from gril_jax.encoders.encoder import EncoderConfig, InteractionConfig, MLPConfig, PixelConfig
from gril_jax.errors import ConfigError, ShapeError
from gril_jax.graphs import activity
from gril_jax.graphs.scene import scene_graph
from gril_jax.losses import heads
from gril_jax.types import DemoBatch

CONFIG = EncoderConfig(num_classes=4, width=8, rounds=1, latent=5)
apply, value_of = jax.jit(encoder.apply), jax.jit(reward.latent_goal_reward)
at = jax.jit(reward.latent_reward)
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


@functools.partial(jax.jit, static_argnames="window")
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
        alone = value_of(make(key), graph, CONFIG)
        np.testing.assert_allclose(value, alone, rtol=1e-4, atol=1e-6)


# --- goals


def _params(goal, scale=2.0):
    return reward.RewardParams({}, jnp.asarray(goal), jnp.asarray(scale), jnp.ones(()))


def _points(*shape, seed=0):
    return jnp.asarray(np.random.default_rng(seed).normal(size=shape), jnp.float32)


def test_of_a_set_the_nearest_goal_counts():
    goals, latents = _points(4, 3), _points(6, 3, seed=1)
    distance = 2.0 * np.linalg.norm(
        np.asarray(latents, np.float64)[:, None] - np.asarray(goals, np.float64), axis=-1
    )
    found = at(_params(goals), latents)
    np.testing.assert_allclose(found, -distance.min(axis=1), rtol=1e-5)
    assert at(_params(goals), goals).tolist() == [0, 0, 0, 0]


def test_a_set_of_one_is_that_goal_and_copies_of_a_goal_add_nothing():
    goal, latents = _points(3), _points(6, 3, seed=1)
    expected = at(_params(goal), latents)
    for goals in (goal[None], jnp.stack([goal, goal])):
        np.testing.assert_allclose(at(_params(goals), latents), expected, rtol=1e-5)


def test_gradients_of_a_set_equal_finite_differences_and_are_finite_at_its_goals():
    goals, point, step = _points(4, 3), _points(3, seed=1), 1e-2 * jnp.eye(3)

    def value(latent):
        return at(_params(goals), latent)

    slope = jax.jit(jax.grad(value))
    difference = (value(point + step) - value(point - step)) / 2e-2
    np.testing.assert_allclose(slope(point), difference, rtol=0.01, atol=1e-3)
    for goal in (goals[0], goals.mean(axis=0)):
        assert np.isfinite(slope(goal)).all()


def test_goals_are_the_mean_or_so_many_of_the_last_frames():
    demos = _demos()
    last = jnp.stack([_latent(demos, i, int(n) - 1) for i, n in enumerate(demos.length)])
    first = np.stack([_latent(demos, i, 0) for i in range(3)])
    each = reward.from_demos(PARAMS, demos, CONFIG, goals=3)
    np.testing.assert_allclose(each.goal, last, rtol=1e-4, atol=1e-5)
    nearest = np.linalg.norm(first[:, None] - np.asarray(last), axis=-1).min(axis=1)
    np.testing.assert_allclose(each.scale, 1 / nearest.mean(), rtol=1e-4)
    np.testing.assert_allclose(value_of(each, _graph(demos, 1, 3), CONFIG), 0, atol=1e-4)


# --- other encoders, other activity


@pytest.mark.parametrize(
    "config",
    [InteractionConfig(num_classes=4, width=6), MLPConfig(num_classes=4, width=6)],
    ids=["interaction", "mlp"],
)
def test_latents_of_other_encoders_equal_a_loop_over_frames(config):
    demos = _demos()
    params = jax.jit(encoder.init)(jax.random.key(0), config)
    latents = reward.demo_latents(params, demos, config)
    for frame in (0, 4):
        graph = _graph(demos, 1, frame)
        expected = apply(params, graph, config)
        np.testing.assert_allclose(latents[1, frame], expected, rtol=1e-4, atol=1e-5)
    found = reward.from_demos(params, demos, config)
    ends = np.asarray(latents)[np.arange(3), np.asarray(demos.length) - 1]
    np.testing.assert_allclose(found.goal, ends.mean(axis=0), rtol=1e-4, atol=1e-5)
    value = value_of(found, graph, config)
    np.testing.assert_allclose(value, at(found, expected), rtol=1e-4)


def test_pixel_frames_have_a_reward_each():
    config = PixelConfig(latent=4)
    params = jax.jit(encoder.init)(jax.random.key(0), config)
    frames = jax.random.uniform(jax.random.key(1), (2, 3, 32, 32, 3))

    @jax.jit  # one program: most of the time is the network's compilation
    def learn(params, frames):
        latents = encoder.apply(params, frames, config)
        found = reward.from_latents(params, latents[:, 0], latents[:, -1])
        return latents, found, reward.latent_goal_reward(found, frames, config)

    latents, found, values = learn(params, frames)
    assert values.shape == (2, 3)
    np.testing.assert_allclose(values, at(found, latents), rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(values[:, 0].mean(), -1.0, rtol=1e-4)


def test_activity_by_another_rule_takes_the_place_of_the_papers():
    demos = _demos()
    bits = jax.jit(jax.vmap(lambda c, s: activity.trajectory(c, s)))(demos.center, demos.size)
    expected = reward.from_demos(PARAMS, demos, CONFIG)
    same = reward.from_demos(PARAMS, demos, CONFIG, active=bits)
    np.testing.assert_allclose(same.goal, expected.goal, rtol=1e-5, atol=1e-6)
    other = reward.from_demos(PARAMS, demos, CONFIG, active=bits & False)
    assert not np.allclose(other.goal, expected.goal)
    latents = reward.demo_latents(PARAMS, demos, CONFIG, active=bits & False)
    np.testing.assert_allclose(
        other.goal,
        np.asarray(latents)[np.arange(3), np.asarray(demos.length) - 1].mean(0),
        rtol=1e-4,
    )


# --- errors


@pytest.mark.parametrize(
    ("change", "options", "kind", "text"),
    [
        ({}, {"active": jnp.zeros((3, 5, 4), bool)}, ShapeError, r"active has shape \(3, 5, 4\)"),
        ({"length": jnp.array([6, 0, 5])}, {}, ShapeError, "length is .*; it must be from 1 to 6"),
        ({"length": jnp.array([6, 7, 5])}, {}, ShapeError, "length is .*; it must be from 1 to 6"),
        ({"center": jnp.zeros((0, 6, 4, 2))}, {}, ShapeError, r"center has shape \(0, 6, 4, 2\)"),
    ],
)
def test_demonstrations_and_goals_that_do_not_fit_are_refused(change, options, kind, text):
    for make in (reward.from_demos, reward.demo_latents):
        with pytest.raises(kind, match=text):
            inspect.unwrap(make)(PARAMS, _demos()._replace(**change), CONFIG, **options)


def test_latents_goals_and_options_that_do_not_fit_are_refused():
    make, value = inspect.unwrap(reward.from_latents), inspect.unwrap(reward.latent_reward)
    with pytest.raises(ShapeError, match=r"first has shape \(2, 3\) and last has shape \(4, 3\)"):
        make({}, _points(2, 3), _points(4, 3))
    with pytest.raises(ShapeError, match=r"goal has shape \(2, 4\), but must be \(3,\)"):
        value(_params(_points(2, 4)), _points(3))
    with pytest.raises(ConfigError, match="PixelConfig, which takes no boxes"):
        inspect.unwrap(reward.from_demos)({}, _demos(), PixelConfig())


def test_a_number_of_goals_are_last_latents_at_equal_steps():
    last = jnp.arange(10.0).reshape(5, 2)
    params = reward.from_latents({}, last + 1.0, last, goals=3)
    assert params.goal.tolist() == last[jnp.array([0, 2, 4])].tolist()
    for count in (0, 6):
        with pytest.raises(ConfigError, match="from 1 to 5"):
            reward.from_latents({}, last, last, goals=count)


def test_with_a_head_the_reward_is_its_progress_less_that_of_the_goal():
    first, last = jax.random.normal(jax.random.key(0), (2, 4, 3))
    head = heads.of("rewind")(jnp.ones((3, 1)), jnp.zeros(()))
    params = reward.from_latents({}, first, last + 2.0, head=head)
    np.testing.assert_allclose(at(params, params.goal), 0.0, atol=1e-6)
    np.testing.assert_allclose(np.mean(at(params, first)), -1.0, rtol=1e-4)
    backwards = reward.from_latents({}, last + 2.0, first, head=head)
    assert backwards.scale == 1.0
    np.testing.assert_allclose(params.start, first.mean(axis=0), rtol=1e-6)
    with pytest.raises(ConfigError, match="goals is 2 and ensemble_size 1; with a head both must"):
        reward.from_latents({}, first, last, head=head, goals=2)
