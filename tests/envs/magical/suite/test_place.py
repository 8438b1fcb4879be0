"""Starts at frames of films, and states that follow a film's boxes."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax import envs
from gril_jax.config import EnvConfig, RunConfig
from gril_jax.types import DemoBatch
from gril_jax.workflows.build import policy_rewards

TASKS = ("move_to_region", "fix_colour", "make_line")  # without blocks, with regions, without them


@functools.cache
def _begun(name):
    env = envs.make(name, engine="impulse")
    return env, jax.jit(env.reset)(jax.random.key(0))


@pytest.mark.parametrize("name", TASKS)
def test_a_start_has_everything_where_its_box_lies(name):
    env, state = _begun(name)
    seen = state.objects
    placed = jax.jit(env.place)(seen.center, seen.size, jax.random.key(1))
    np.testing.assert_allclose(placed.objects.center, seen.center, atol=1e-3)
    np.testing.assert_array_equal(placed.objects.label, seen.label)
    assert jax.tree.map(jnp.shape, placed) == jax.tree.map(jnp.shape, state)
    assert not placed.data.velocity.any()


@pytest.mark.parametrize("name", TASKS)
def test_a_shifted_state_follows_boxes_and_keeps_its_angles(name):
    env, state = _begun(name)
    moving = jnp.asarray([not c.endswith("region") for c in env.object_names])
    center = state.objects.center + jnp.where(moving[:, None], 0.05, 0.0)
    moved = jax.jit(env.shifted)(state, center)
    np.testing.assert_allclose(moved.objects.center, center, atol=1e-5)
    np.testing.assert_array_equal(moved.data.pose[:, 2], state.data.pose[:, 2])


def test_a_robot_that_is_all_that_moves_counts_as_an_object():
    assert not _begun("move_to_region")[1].objects.is_robot.any()
    assert _begun("make_line")[1].objects.is_robot.tolist() == [True, False, False, False, False]


def test_padded_variants_have_observations_of_one_size_and_nothing_where_nothing_is():
    plain = jax.jit(envs.make("cluster_shape", engine="impulse").reset)(jax.random.key(0))
    sizes = set()
    for variant in ("demo", "shape", "all"):
        env = envs.make("cluster_shape", engine="impulse", variant=variant, padded=True)
        state = jax.jit(env.reset)(jax.random.key(0))
        sizes.add((env.observation_size, state.obs.shape, state.objects.label.shape))
        if variant == "demo":
            np.testing.assert_array_equal(state.obs[: len(plain.obs)], plain.obs)
            assert not state.obs[len(plain.obs) :].any()
            there = np.asarray(state.objects.size).any(axis=1)
            assert there.sum() == len(plain.objects.label)
            np.testing.assert_array_equal(state.objects.center[there], plain.objects.center)
    assert len(sizes) == 1


def test_frames_of_films_leave_the_places_free_that_only_variants_fill():
    env = {"name": "cluster_shape", "options": ("padded=True",), "observation": "plain"}
    config = RunConfig(env=EnvConfig(**env, varied_starts=0.0))
    seen = jax.jit(envs.make("cluster_shape", engine="impulse").reset)(jax.random.key(0)).objects
    film = lambda x: jnp.asarray(x)[None, None].repeat(3, axis=1)  # noqa: E731
    demos = DemoBatch(
        film(seen.center), film(seen.size), seen.label[None], seen.is_robot[None],
        jnp.ones((1, len(seen.label)), bool), jnp.array([3]),
    )  # fmt: skip
    found = policy_rewards._frames(config, demos)
    there = np.asarray(found.size[0]).any(axis=1)
    assert (len(there), there.sum()) == (11, 9)
    np.testing.assert_array_equal(np.asarray(found.center[0])[there], seen.center)
    assert not np.asarray(found.active)[:, ~there].any()
    assert (np.asarray(found.center)[:, ~there] == 2).all()
