"""Phrases on frames: what starts, what stops, and that robots do not count."""

import numpy as np

from gril_jax.demos.demo import Tracks
from gril_jax.report.happenings import at_frames

CLASSES = ("robot", "star", "square")


def _tracks(length=40):
    """The robot never rests; the star moves in frames 10 to 20, the square in 20 to 30."""
    time = np.arange(length, dtype=np.float32)
    center = np.zeros((length, 3, 2), np.float32)
    center[:, 0, 0] = 0.1 * time
    center[:, 1, 0] = 0.1 * np.clip(time - 10, 0, 10)
    center[:, 2, 1] = 0.1 * np.clip(time - 20, 0, 10)
    size = np.full((length, 3, 2), 0.3, np.float32)
    return Tracks(center, size, np.arange(3, dtype=np.int32), np.ones((length, 3), bool))


def test_each_frame_says_what_starts_goes_on_or_ends_there():
    found = at_frames(_tracks(), [2, 10, 15, 20, 30, 39], CLASSES)
    nothing = "nothing moves but the robot, if that does"
    assert found == [
        nothing, "the star starts to move", "the star is on its way",
        "the star comes to rest and the square starts to move", "the square comes to rest", nothing,
    ]  # fmt: skip


def test_the_detectors_jitter_is_no_motion():
    tracks = _tracks()
    jitter = 0.01 * np.random.default_rng(0).normal(size=tracks.center.shape).astype(np.float32)
    assert at_frames(tracks._replace(center=tracks.center + jitter), [20], CLASSES) == [
        "the star comes to rest and the square starts to move"
    ]
