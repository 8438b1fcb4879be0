"""Stages: what holds, what counts, and states that are made so."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.stages import Stage, Stages, free_place
from support.audit_tasks import SIZE, START, packing


def _stage(name, **more):
    return Stage(name, (1,), lambda c, s: c[1, 0] > 0, lambda k, c, s: c, **more)


def _task(*stages):
    return Stages(stages, (1,), 1.0, lambda task, c, s: jnp.zeros(()))


def test_a_task_has_a_stage_and_requires_only_what_comes_before():
    with pytest.raises(ValueError, match="stages is empty"):
        _task()
    with pytest.raises(ValueError, match="stage 'a' requires 'b', not declared before"):
        _task(_stage("a", required_before=("b",)), _stage("b"))


def test_a_stage_counts_only_if_what_it_requires_is_done():
    task, center = packing(), START
    packed = center.at[2].set(jnp.array([0.5, 0.5]))
    assert task.done(packed, SIZE).tolist() == [False, False, False]
    opened = packed.at[1].set(jnp.array([-0.8, 0.8]))
    assert task.done(opened, SIZE).tolist() == [True, True, False]
    np.testing.assert_allclose(task.progress(opened, SIZE), 2 / 3)


def test_states_are_arranged_with_exactly_the_wanted_stages():
    task = packing()
    wanted = jnp.array([[False] * 3, [True, False, False], [True, True, False], [True] * 3])
    keys = jax.random.split(jax.random.key(0), (5, 4))
    arrange = jax.vmap(lambda k, c, w: task.arrange(k, c, SIZE, w), (0, None, 0))
    both = jax.jit(jax.vmap(arrange, (0, None, None)))
    from_start = both(keys, START, wanted)
    done = jax.vmap(jax.vmap(lambda c: task.done(c, SIZE)))
    np.testing.assert_array_equal(done(from_start), jnp.tile(wanted, (5, 1, 1)))
    from_success = both(keys, from_start[0, 3], wanted)  # undoes what is not wanted
    np.testing.assert_array_equal(done(from_success), jnp.tile(wanted, (5, 1, 1)))
    np.testing.assert_array_equal(from_start[:, :, 4], jnp.broadcast_to(START[4], (5, 4, 2)))


def test_a_success_has_each_object_anywhere_where_its_stage_holds():
    shoe = Stage(
        "shoe in", (2,), lambda c, s: jnp.sum((c[2] - 0.5) ** 2) < 0.3**2,
        lambda k, c, s: c.at[2].set(0.5), within=lambda c, s: (jnp.full(2, 0.2), jnp.full(2, 0.8)),
    )  # fmt: skip
    task = dataclasses.replace(packing(), stages=(packing().stages[0], shoe))
    keys = jax.random.split(jax.random.key(2), 400)
    made = jax.jit(jax.vmap(lambda k: task.fulfil(k, START, SIZE)))(keys)
    assert jax.vmap(lambda c: task.done(c, SIZE))(made).all()
    away = np.linalg.norm(np.asarray(made[:, 2]) - 0.5, axis=1) / 0.3
    # Uniform in the disc: a quarter of the places is within half of its radius.
    assert abs((away < 0.5).mean() - 0.25) < 0.08
    assert (np.asarray(made[:, 1, 0]) < -0.3).all()  # the lid, as `place` alone has it
    np.testing.assert_array_equal(made[:, 3:], jnp.broadcast_to(START[3:], (400, 2, 2)))


def test_without_faults_there_are_none():
    assert packing().faulty(START, SIZE).shape == (0,)


def test_a_scattered_object_stays_on_the_plane_clear_of_others_and_alone_moves():
    task = packing()
    scatter = jax.vmap(lambda k: task.scatter(k, 2, START, SIZE))
    center = np.asarray(scatter(jax.random.split(jax.random.key(1), 50)))
    assert (np.abs(center[:, 2]) <= 1 - 0.1 + 1e-6).all()
    apart = np.linalg.norm(center[:, 2, None] - center[:, [1, 3, 4]], axis=-1)
    assert (apart >= 0.2 - 1e-6).all()
    others = [0, 1, 3, 4]
    np.testing.assert_array_equal(center[:, others], np.tile(START[jnp.array(others)], (50, 1, 1)))
    assert len(np.unique(center[:, 2, 0])) == 50


def test_a_free_place_is_allowed_even_if_no_place_is_clear():
    crowded = dataclasses.replace(packing(), movable=(1, 2, 3))
    size = SIZE.at[1].set(4.0)  # fills the plane
    place = functools.partial(
        free_place, low=-jnp.ones(2), high=jnp.ones(2), others=crowded.movable,
        allowed=lambda c: c[2, 0] > 0,
    )  # fmt: skip
    center = jax.vmap(lambda k: place(k, 2, START, size))(jax.random.split(jax.random.key(2), 9))
    assert (center[:, 2, 0] > 0).all()
