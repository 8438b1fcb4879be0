"""Pictures of the table: their boxes are the camera's, and nearer things hide farther ones."""

import importlib

import jax
import numpy as np
import pytest
from gril_jax.envs.tabletop import boxes as cameras
from gril_jax.envs.tabletop import demonstrations as detector
from gril_jax.envs.tabletop import render as rendering

from gril_jax import envs

PIXELS = 256


@pytest.fixture(scope="module")
def scene():
    """The task, a start without jitter, and its boxes as a function of joint positions."""
    env = envs.make("shoes_in_box", jitter=0.0)
    start = jax.jit(env.reset)(jax.random.key(0))

    def boxes(qpos):
        data = start.data._replace(motion=start.data.motion._replace(qpos=qpos))
        return cameras.project(env.camera, env.world_boxes(data))

    return env, start, jax.jit(boxes)


@pytest.fixture(scope="module")
def renderer(scene):
    try:
        made = rendering.Renderer(*scene[:2], pixels=PIXELS)
    except RuntimeError as error:
        pytest.skip(str(error))
    yield made
    made.close()


def _poses(start, count):
    """Joint positions with an open lid, and things at random above the table."""
    rng = np.random.default_rng(0)
    for _ in range(count):
        qpos = np.asarray(start.data.motion.qpos).copy()
        qpos[:7] += rng.uniform(-0.15, 0.15, 7)
        qpos[7:9] = rng.uniform(0, 0.04)
        qpos[9] = rng.uniform(0, 2.6)
        for at in (10, 17):
            turn = rng.normal(size=4)
            qpos[at : at + 3] = rng.uniform([0.3, -0.3, 0.1], [0.7, 0.3, 0.4])
            qpos[at + 3 : at + 7] = turn / np.linalg.norm(turn)
        yield qpos


def test_a_visible_things_box_is_the_cameras_within_two_pixels(scene, renderer):
    env, start, boxes = scene
    fixtures, groups = np.asarray(start.data.fixtures), renderer._model.geom_group.copy()
    errors = []
    for qpos in _poses(start, 4):
        center, size = map(np.asarray, boxes(qpos))
        for index in range(len(env.classes)):
            # alone, so that nothing hides it
            renderer._model.geom_group[:] = np.where(renderer._owner == index, groups, 5)
            thing = renderer.picture(qpos, fixtures).thing
            seen = detector.detect(thing, len(env.classes))
            assert seen.seen.tolist() == [i == index for i in range(len(env.classes))]
            low, high = center[index] - size[index] / 2, center[index] + size[index] / 2
            errors.append(seen.center[index] - seen.size[index] / 2 - np.maximum(low, -1))
            errors.append(seen.center[index] + seen.size[index] / 2 - np.minimum(high, 1))
    renderer._model.geom_group[:] = groups
    assert np.abs(errors).max() * PIXELS / 2 < 2


def test_a_nearer_thing_hides_a_farther_one(scene, renderer):
    _, start, boxes = scene
    qpos, fixtures = np.asarray(start.data.motion.qpos).copy(), np.asarray(start.data.fixtures)
    qpos[9] = 0.0
    qpos[10:13] = fixtures[0, :3] + [0, 0, 0.03]  # shoe A lies in the closed box
    seen = detector.detect(renderer.picture(qpos, fixtures).thing, 7)
    assert seen.seen.tolist() == [*[True] * 5, False, True]
    qpos[9] = 2.6
    seen = detector.detect(renderer.picture(qpos, fixtures).thing, 7)
    whole = np.asarray(boxes(qpos)[1])
    assert seen.seen[5]
    assert (seen.size[5] < whole[5] + 0.02).all()


def test_a_frame_has_colours_and_the_same_moment_the_same_bytes(scene, renderer):
    _, start, _ = scene
    qpos, fixtures = np.asarray(start.data.motion.qpos), np.asarray(start.data.fixtures)
    first, again = renderer.picture(qpos, fixtures), renderer.picture(qpos, fixtures)
    np.testing.assert_array_equal(first.frame, again.frame)
    np.testing.assert_array_equal(first.thing, again.thing)
    assert first.frame.shape == (PIXELS, PIXELS, 3)
    red, _, blue = first.frame[first.thing == 6].mean(axis=0)  # a shoe is brown
    assert red > 1.5 * blue
    np.testing.assert_array_equal(renderer.frame(qpos, fixtures), first.frame)


def test_painting_leaves_the_environments_own_model_alone(scene, renderer):
    env = scene[0]
    assert (env.physics.mj_model.geom_group == 0).all()
    assert (renderer._model.geom_group != 0).any()


def test_without_opengl_one_sentence_says_what_to_do(scene, monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(RuntimeError, match=r"no OpenGL works here without a display.*MUJOCO_GL"):
        rendering.Renderer(*scene[:2])


def test_a_size_out_of_range_is_named(scene):
    with pytest.raises(ValueError, match="pixels is 8, but must be from 16 to 2048"):
        rendering.Renderer(*scene[:2], pixels=8)
