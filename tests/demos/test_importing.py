"""Videos, boxes beside them and human demonstrations become demo sets."""

import pathlib

import numpy as np
import pytest
from support import scenes
from support.scenes import scene

from gril_jax.demos.demo_set import demo_batch, load_demo_set
from gril_jax.demos.importing import import_magical, import_videos
from gril_jax.demos.vision.detect import PALETTE_CLASSES
from gril_jax.demos.vision.video import write_video
from gril_jax.errors import DemoError

CLASSES = ("goal", "robot", "cup")


def push_video(path: pathlib.Path, fps=8.0, frames=16):
    """The square moves for six frames, then rests."""
    poses = [(-0.6 + 0.1 * min(t, 6), 0.5, 0.3) for t in range(frames)]
    blocks = [{"green square": p, "yellow circle": (0.7, -0.7, 0)} for p in poses]
    write_video(path, [scene(b, side=256, smooth=True) for b in blocks], fps)


def test_videos_become_a_demo_set(tmp_path):
    (tmp_path / "in").mkdir()
    push_video(tmp_path / "in" / "one.mp4")
    push_video(tmp_path / "in" / "two.mp4", frames=9)
    told = []
    report = import_videos(
        tmp_path / "in",
        tmp_path / "set",
        scenes.HALF_EXTENT,
        outcome="success",
        progress=lambda *news: told.append(news),
    )
    loaded = load_demo_set(tmp_path / "set")
    assert [(r.name, r.frames, r.trimmed) for r in report] == [("one", 12, 4), ("two", 9, 0)]
    assert told == [(1, 2, report[0]), (2, 2, report[1])]
    assert [r.seen for r in report] == [1.0, 1.0]
    assert loaded.classes == PALETTE_CLASSES
    assert loaded.entries[0].objects == ["goal", "robot", "green square", "yellow circle"]
    assert (loaded.entries[0].outcome, loaded.entries[0].trimmed) == ("success", 4)
    np.testing.assert_allclose(loaded.tracks[0].center[-1, 2], [0.0, 0.5], atol=0.01)
    assert demo_batch(loaded).length.tolist() == [12, 9]


def test_boxes_beside_the_videos_replace_detection(tmp_path):
    (tmp_path / "in").mkdir()
    push_video(tmp_path / "in" / "one.mp4", frames=4)
    rows = [f"{t},cup,{10 * t},0,{10 * t + 10},10" for t in range(4)]
    rows = ["frame,class,x_min,y_min,x_max,y_max", "0,goal,0,0,64,64", *rows]
    (tmp_path / "in" / "one.csv").write_text("\n".join(rows))
    options = {"half_extent": 1.0, "boxes": True, "classes": CLASSES}
    import_videos(tmp_path / "in", tmp_path / "set", **options)
    loaded = load_demo_set(tmp_path / "set")
    assert loaded.entries[0].objects == ["goal", "cup"]
    x = loaded.tracks[0].center[:, 1, 0]
    np.testing.assert_allclose(np.diff(x), 10 / 128, atol=1e-6)
    (tmp_path / "in" / "one.csv").unlink()
    with pytest.raises(DemoError, match=r"one\.csv: the boxes file cannot be read"):
        import_videos(tmp_path / "in", tmp_path / "set", **options)
    assert len(load_demo_set(tmp_path / "set").entries) == 1


def test_folders_of_videos_that_do_not_fit_are_refused_by_name(tmp_path):
    with pytest.raises(DemoError, match="holds no video"):
        import_videos(tmp_path, tmp_path / "set", 1.0)
    push_video(tmp_path / "a.mp4", frames=2)
    with pytest.raises(DemoError, match="half_extent: must be above 0"):
        import_videos(tmp_path, tmp_path / "set", 0.0)
    push_video(tmp_path / "b.mp4", fps=10.0, frames=2)
    with pytest.raises(DemoError, match=r"b\.mp4: has 10 frames per second, but a\.mp4 has 8"):
        import_videos(tmp_path, tmp_path / "set", scenes.HALF_EXTENT)
    (tmp_path / "a.mov").write_bytes(b"")
    with pytest.raises(DemoError, match="two videos are called 'a'"):
        import_videos(tmp_path, tmp_path / "set", 1.0)
    assert not (tmp_path / "set").exists()


@pytest.mark.skipif(
    not (scenes.shared_data() / "magical").is_dir(), reason="no human demonstrations here"
)
def test_human_demonstrations_become_a_demo_set(tmp_path):
    source = scenes.shared_data() / "magical"
    (tmp_path / "in").mkdir()
    for number in ("004", "010"):
        name = f"demo-MatchRegions-Demo-v0-{number}.pkl.gz"
        (tmp_path / "in" / name).symlink_to(source / name)
    report = import_magical(tmp_path / "in", tmp_path / "set")
    loaded = load_demo_set(tmp_path / "set")
    assert (loaded.task, loaded.half_extent, loaded.fps) == ("match_regions", 1.02, 8.0)
    assert [entry.outcome for entry in loaded.entries] == ["success", "success"]
    for item, done in zip(report, (81, 98), strict=True):  # steps at which both are inside
        assert done <= item.frames <= done + 15
        assert item.frames + item.trimmed == 121
        assert item.seen == 1.0
    batch = demo_batch(loaded)
    assert batch.center.shape[2] == 7
    assert np.asarray(batch.is_robot).sum(1).tolist() == [1, 1]
