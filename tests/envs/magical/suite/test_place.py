"""Starts at frames of films, and states that follow a film's boxes."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax import envs

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
