"""Boxes of every so many frames lie on lines between them; a tracker's misses do not."""

import numpy as np
import pytest
from support.kitchen_films import write_csv

from gril_jax.demos.formats.record import Box
from gril_jax.demos.importing import import_videos
from gril_jax.demos.tracking.annotated import annotated, by_person, mended_between
from gril_jax.demos.tracking.identities import linked
from gril_jax.demos.tracking.mending import mended
from gril_jax.demos.vision.video import write_video

TRUE = 91  # frames


def way():
    """(T, 2, 4): a cup and a hand that go far and back between the frames of whole seconds."""
    frames = np.arange(TRUE)
    x = np.interp(frames, [0, 30, 40, 50, 60, 90], [0, 0, 40, 5, 45, 45])
    hand = np.interp(frames, [0, 10, 20, 90], [50, 2, 50, 2])
    low = np.stack([np.stack([x, x / 4], 1), np.stack([hand, hand / 2], 1)], 1)
    return np.concatenate([low, low + 10], axis=-1)


@pytest.mark.parametrize(
    ("frames", "total", "found"),
    [
        (range(0, 91, 10), 91, range(0, 91, 10)),
        ([0, 10, 20, 50, 60], 70, [0, 10, 20, 50, 60]),
        ([*range(0, 81, 10), 85], 86, [*range(0, 81, 10), 85]),
        ([0, 5, 10, 20, 30, 40, 45, 50], 60, [0, 5, 10, 20, 30, 40, 45, 50]),
        ([0, 30, 60, 90, 120, 149], 160, [0, 30, 60, 90, 120, 149]),
        (range(4, 90, 5), 90, range(4, 90, 5)),
        (range(90), 90, None),
        (range(30), 90, None),
        ([3], 90, None),
        ([0, 1, 2, 30, 31, 60, 61, 62], 90, None),
        ([t for t in range(90) if t % 3 != 1], 90, None),
    ],
)
def test_a_regular_gap_is_told_from_misses(frames, total, found):
    at = annotated(frames, total)
    assert (None if at is None else at.tolist()) == (None if found is None else [*found])


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("seen", [0.05, 0.2, 0.4])
def test_misses_at_random_are_no_annotation(seed, seen):
    frames = np.flatnonzero(np.random.default_rng(seed).random(300) < seen)
    assert annotated(frames.tolist(), 300) is None


@pytest.mark.parametrize("fps", [3.0, 10.0, 60.0, 140.0])
@pytest.mark.parametrize("jitter", [None, 2.0])
def test_annotated_boxes_lie_on_lines_whatever_the_speed(fps, jitter):
    edges, at = way(), np.arange(0, TRUE, 10)
    seen = np.full_like(edges, np.nan)
    seen[at] = edges[at]
    found = mended_between(seen, at, fps, hands=[1], jitter=jitter, smoothing=1)
    np.testing.assert_allclose(found.edges, edges, atol=1e-9)
    assert found.seen.all()
    assert (found.off, found.carried) == (0, 0)


def test_frames_beyond_the_annotation_are_not_seen():
    edges, at = way(), np.arange(0, 51, 10)
    seen = np.full_like(edges, np.nan)
    seen[at] = edges[at]
    seen[30, 0] = np.nan
    found = mended_between(seen, at, 10.0)
    assert found.seen.sum(axis=0).tolist() == [60 - 19, 60]


def test_every_third_frame_is_repaired_as_a_video_of_these():
    x = np.arange(3.0 * TRUE)[:, None, None] / 9
    edges = x * [1, 0, 1, 0] + np.array([[0.0, 0, 10, 10], [50, 50, 70, 70]])
    edges[90:150] = np.nan  # nothing is seen for a time
    edges[30, 0] += 500.0  # a sighting of something else
    at = np.arange(0, len(edges), 3)
    seen = np.full_like(edges, np.nan)
    seen[at] = edges[at]
    found = mended_between(seen, at, 90.0)
    alone = mended(edges[at], 30.0)
    assert found.off == alone.off == 1
    np.testing.assert_allclose(found.edges[at], alone.edges)
    assert not found.seen[95:145].any()


def test_an_annotator_s_identity_counts_however_far_objects_went():
    places = [(0.0, 90.0), (90.0, 0.0), (0.0, 90.0)]
    rows = [
        Box(10 * n, "cup", (x, 0.0, x + 10, 10.0), 1.0, str(which))
        for n, pair in enumerate(places)
        for which, x in enumerate(pair)
    ]
    found = linked(rows, 21, 2, sparse=True)
    assert found.edges[::10, 0, 0].tolist() == [0.0, 90.0, 0.0]
    assert found.renewed == 0
    late = [row for row in rows if row.frame > 0 or row.track == "0"]
    assert linked(late, 21, 1, sparse=True).edges[10, 0, 0] in (0.0, 90.0)


def test_a_video_annotated_once_a_second_is_imported_as_it_was(tmp_path):
    frames = [np.full((48, 64, 3), 3 * t % 255, np.uint8) for t in range(TRUE)]
    write_video(tmp_path / "a.mp4", frames, 10.0)
    rows = [
        (t, name, *way()[t, which].tolist(), 1.0, "")
        for t in range(0, TRUE, 10)
        for which, name in enumerate(("cup", "hand"))
    ]
    write_csv(tmp_path / "a.csv", rows)
    made = import_videos(tmp_path, robot=["hand"])
    x = (made[0].tracks.center[:, 0, 0] + 0.5) * 64
    kept = len(made[0])
    np.testing.assert_allclose(x, way()[:kept, 0, 0] + 5, atol=1e-3)
    assert made[0].tracks.seen.all()
    assert "a: boxes are those of one frame in 10; between these they lie on lines" in made.notes
    assert "doubtful" not in made.notes


@pytest.mark.parametrize("fps", [15.0, 60.0, 140.0])
def test_what_a_person_drew_often_lies_on_lines_too(fps):
    edges, at = way(), np.arange(0, TRUE, 10)
    seen = np.full_like(edges, np.nan)
    seen[at] = edges[at]
    found = mended_between(seen, at, 10 * fps, hands=[1], drawn=True)
    np.testing.assert_allclose(found.edges, edges, atol=1e-9)


@pytest.mark.parametrize(
    ("sure", "drawn", "found"),
    [((1, 1), False, True), ((0.9, 0.9), False, True), ((0.9, 0.8), False, False),
     ((0.9, 0.8), True, True)],
)  # fmt: skip
def test_a_person_s_boxes_are_told_by_their_tool_or_their_confidence(sure, drawn, found):
    edges = (0.0, 0.0, 9.0, 9.0)
    boxes = [Box(n, "cup", edges, one, drawn=drawn) for n, one in enumerate(sure)]
    assert by_person(boxes) == found


FAST = np.array([10.0] * 12 + [10, 40, 40, 10, 12, 44, 8, 8, 40] + [40.0] * 9)


@pytest.mark.parametrize(("fps", "tool"), [(30.0, "xml"), (2.0, "csv")])
def test_what_was_drawn_in_all_frames_is_believed_whatever_the_speed(tmp_path, fps, tool):
    frames = [np.full((48, 64, 3), 3 * t, np.uint8) for t in range(len(FAST))]
    write_video(tmp_path / "a.mp4", frames, fps)
    way = FAST if tool == "xml" else 25 + 20 * np.sin(1.9 * np.arange(len(FAST)) ** 1.1)
    places = {"cup": way, "hand": np.linspace(0, 20, len(FAST))}
    if tool == "csv":
        rows = [(t, name, x[t], 1, x[t] + 9, 9, 1 - t / 99, "")
                for t in range(len(FAST)) for name, x in places.items()]  # fmt: skip
        write_csv(tmp_path / "a.csv", rows)
    else:
        box = '<box frame="{}" keyframe="1" outside="0" xtl="{}" ytl="1" xbr="{}" ybr="9"/>'
        tracks = "".join(
            f'<track id="{name}" label="{name}" source="manual">'
            + "".join(box.format(t, x[t], x[t] + 9) for t in range(len(FAST)))
            + "</track>"
            for name, x in places.items()
        )
        (tmp_path / "a.xml").write_text(f"<annotations>{tracks}</annotations>")
    made = import_videos(tmp_path, robot=["hand"], fps=fps)
    x = (made[0].tracks.center[:, 0, 0] + 0.5) * 64 - 4.5
    np.testing.assert_allclose(x, way[: len(x)], atol=1e-3)
