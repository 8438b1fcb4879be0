"""Detections of `supervision` from a function of the user's own, and a tracker's identities."""

from types import SimpleNamespace

import numpy as np
import pytest
from support.odd_videos import encoded

from gril_jax.demos.own_detector import detecting
from gril_jax.demos.vision.timed import look
from gril_jax.errors import DemoError


def detections(edges, names=None, tracks=None, sure=None):
    """What `supervision.Detections` has, if that is not installed; else the real one."""
    edges = np.array(edges, np.float32).reshape(-1, 4)
    given = {
        "xyxy": edges, "confidence": None if sure is None else np.array(sure, np.float32),
        "class_id": np.zeros(len(edges), int),
        "tracker_id": None if tracks is None else np.array(tracks),
        "data": {} if names is None else {"class_name": np.array(names)},
    }  # fmt: skip
    try:
        import supervision
    except ImportError:
        return SimpleNamespace(**given)
    return supervision.Detections(**given)


@pytest.fixture
def film(tmp_path):
    return look(encoded(tmp_path / "a.mp4", frames=3))


def test_detections_have_names_scores_and_identities(film):
    cups = [[9, 9, 40, 40], [50, 9, 90, 40]]
    found = detections(cups, ["cup", "cup"], [7, -1], [0.5, 0.75])
    boxes = detecting(lambda frames: [found, detections([], [], []), None])(film)
    assert [(one.frame, one.name, one.track, one.confidence) for one in boxes] == [
        (0, "cup", "7", 0.5), (0, "cup", None, 0.75),
    ]  # fmt: skip
    assert boxes[1].edges == (50, 9, 90, 40)


def test_without_a_tracker_there_is_no_identity(film):
    found = detections([[9, 9, 40, 40]], ["cup"])
    boxes = detecting(lambda frames: (found for _ in frames))(film)
    assert [(one.frame, one.track, one.confidence) for one in boxes] == [
        (0, None, 1.0), (1, None, 1.0), (2, None, 1.0),
    ]  # fmt: skip


def test_detections_without_names_or_of_one_frame_for_all_are_a_sentence(film):
    nameless = detections([[9, 9, 40, 40]])
    with pytest.raises(DemoError, match=r"a.mp4, frame 0: these detections have no data\['class_n"):
        detecting(lambda frames: [nameless] * len(frames))(film)
    one = detections([[9, 9, 40, 40]], ["cup"])
    with pytest.raises(
        DemoError, match=r"frames 0 to 2 of a.mp4; it must give a list with the box"
    ):
        detecting(lambda frames: one)(film)
