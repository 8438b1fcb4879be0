"""Boxes read from pictures whose things are known."""

import numpy as np
import pytest
from gril_jax.envs.base import ExpertError
from gril_jax.envs.tabletop import demonstrations as detector

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
