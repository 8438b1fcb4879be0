"""Boxes read from pictures whose things are known."""

import importlib

import jax
import numpy as np
import pytest
from gril_jax.envs.base import ExpertError
from gril_jax.envs.tabletop import boxes as cameras
from gril_jax.envs.tabletop import demonstrations as detector
from gril_jax.envs.tabletop import render as rendering

from gril_jax import envs

NAMES = ("left finger", "right finger", "hand")


def _picture(*patches, pixels=20):
    thing = np.full((pixels, pixels), -1, np.int8)
    for index, (top, left, bottom, right) in enumerate(patches):
        thing[top:bottom, left:right] = index
    return thing


def _video(count=400):
    rng = np.random.default_rng(0)
    center = rng.uniform(-0.5, 0.5, (count, 3, 2)).astype(np.float32)
    size = rng.uniform(0.1, 0.3, (count, 3, 2)).astype(np.float32)
    return detector.Sightings(center, size, np.ones((count, 3), bool))


def test_a_box_is_that_of_the_visible_pixels_with_y_up():
    found = detector.detect(_picture((0, 0, 10, 20), (5, 4, 15, 8)), 3)
    # the second patch hides a part of the first, which reaches as far as before
    np.testing.assert_allclose(found.center[0], [0, 0.5], atol=1e-6)
    np.testing.assert_allclose(found.size[0], [2, 1], atol=1e-6)
    np.testing.assert_allclose(found.center[1], [-0.4, 0], atol=1e-6)
    np.testing.assert_allclose(found.size[1], [0.4, 1], atol=1e-6)
    assert found.seen.tolist() == [True, True, False]


def test_what_is_hidden_but_for_a_few_pixels_is_not_seen():
    hidden = _picture((2, 2, 6, 6), (2, 2, 6, 5), (5, 2, 6, 6))
    assert detector.detect(hidden, 3).seen.tolist() == [False, True, True]
    assert detector.detect(hidden, 3, least=3).seen.all()


def test_what_is_not_seen_keeps_its_last_box_or_takes_its_first():
    exact = _video(6)
    exact.seen[:, 0] = [False, True, True, False, False, True]
    filled = detector.carried(exact, NAMES)
    np.testing.assert_array_equal(filled.center[:, 0], exact.center[[1, 1, 2, 2, 2, 5], 0])
    np.testing.assert_array_equal(filled.size[:, 1], exact.size[:, 1])
    np.testing.assert_array_equal(filled.seen, exact.seen)


def test_what_is_never_seen_is_named():
    exact = _video(5)
    exact.seen[:, 2] = False
    with pytest.raises(ExpertError, match="'hand' is not to be seen in any of 5 frames"):
        detector.carried(exact, NAMES)


def test_frames_are_stacked_in_order():
    pictures = [_picture((0, 0, 4, 4)), _picture((4, 4, 8, 8))]
    video = detector.stacked([detector.detect(p, 1) for p in pictures])
    assert video.center.shape == (2, 1, 2)
    assert video.center[0, 0, 0] < video.center[1, 0, 0]


# --- Pictures of the table: their boxes are the camera's, and nearer things hide farther ones

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
