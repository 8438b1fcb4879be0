"""Videos, boxes beside them and human demonstrations become demo sets."""

import dataclasses
import pathlib
from fractions import Fraction

import av
import numpy as np
import pytest
from support import kitchen_films, odd_videos, scenes
from support.scenes import scene

import gril_jax as gril
from gril_jax.demos.demo_set import demo_batch, load_demo_set, save_demo_set
from gril_jax.demos.importing import import_videos
from gril_jax.demos.schema import outcomes
from gril_jax.demos.vision.detect import PALETTE_CLASSES
from gril_jax.demos.vision.video import write_video
from gril_jax.errors import DemoError


def push_video(path: pathlib.Path, fps=8.0, frames=16):
    """The square moves for six frames, then rests."""
    poses = [(-0.6 + 0.1 * min(t, 6), 0.5, 0.3) for t in range(frames)]
    blocks = [{"green square": p, "yellow circle": (0.7, -0.7, 0)} for p in poses]
    write_video(path, [scene(b, side=256, smooth=True) for b in blocks], fps)


def colour(folder, half_extent=scenes.HALF_EXTENT):
    return import_videos(folder, folder / "set", boxes="colour", half_extent=half_extent)


def test_videos_become_a_demo_set(tmp_path):
    (tmp_path / "in").mkdir()
    push_video(tmp_path / "in" / "one.mp4")
    push_video(tmp_path / "in" / "two.mp4", frames=9)
    read, written = [], []
    made = import_videos(
        tmp_path / "in",
        tmp_path / "set",
        boxes="colour",
        half_extent=scenes.HALF_EXTENT,
        outcome="success",
        progress=lambda *news: read.append(news),
        writing=lambda *news: written.append(news),
    )
    loaded = load_demo_set(tmp_path / "set")
    assert [(d.name, len(d), d.trimmed) for d in made] == [("one", 12, 4), ("two", 9, 0)]
    assert read == written == [(1, 2), (2, 2)]
    assert made == loaded
    assert all(demo.tracks.seen.all() for demo in made)
    assert loaded.classes == PALETTE_CLASSES
    assert loaded.objects(loaded[0]) == ["goal", "robot", "green square", "yellow circle"]
    assert (loaded[0].outcome, loaded[0].trimmed) == ("success", 4)
    np.testing.assert_allclose(loaded[0].tracks.center[-1, 2], [0.0, 0.5], atol=0.01)
    assert demo_batch(loaded).length.tolist() == [12, 9]


def test_a_set_in_memory_is_the_one_that_is_written(tmp_path):
    kitchen_films.write_films(tmp_path / "in", 2, fps=10.0, width=64, height=48, tempo=2.0)
    made = import_videos(tmp_path / "in", robot=["hand"])
    assert [path.name for path in tmp_path.iterdir()] == ["in"]
    assert made.folder is None
    for out, save in (("a", made.save), ("b", lambda out: save_demo_set(made, out))):
        save(tmp_path / out)
        assert load_demo_set(tmp_path / out) == made
    written = import_videos(tmp_path / "in", tmp_path / "c", robot=["hand"])
    assert written == made
    assert written.notes == made.notes == (tmp_path / "c" / "import.txt").read_text()
    assert load_demo_set(tmp_path / "c").folder == tmp_path / "c"
    assert [demo.frames.shape for demo in made] == [demo.frames.shape for demo in written]
    assert not written == dataclasses.replace(made, demos=made.demos[::-1])


def test_a_set_is_a_sequence_of_named_demonstrations_with_boxes(tmp_path):
    kitchen_films.write_films(tmp_path / "in", 3, fps=10.0, width=64, height=48, tempo=2.0)
    outcome = {"kitchen_00": "success", "kitchen_01": "failure", "kitchen_02": "success"}
    made = import_videos(tmp_path / "in", robot=["hand"], outcome=outcome)
    assert len(made) == 3
    assert made.names == [*outcome]
    assert [demo.outcome for demo in made] == [*outcome.values()]
    assert made["kitchen_01"] is made[1]
    assert made.split() == {
        "train": ["kitchen_00"], "validation": ["kitchen_02"], "failure": ["kitchen_01"]
    }  # fmt: skip
    assert made.boxes.length.tolist() == [len(demo) for demo in made]
    assert repr(made).endswith("10 a second; classes: coaster, cup, hand (robot), spoon)")
    with pytest.raises(DemoError, match="there is no demonstration 'x'"):
        made["x"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"half_extent": 0.0}, "half_extent is 0.0, but must be above 0"),
        ({"fps": float("nan")}, "fps is nan, but must be from"),
        ({"jitter": -1.0}, "jitter is -1.0, but must be from 0"),
        ({"smoothing": 4}, "smoothing is 4, but must be odd"),
        ({"outcome": "Failure"}, "outcome of .* is 'Failure', but must be one of success, failure"),
        ({"outcome": {"gone": "failure"}}, "given for 'gone', but no video has that name"),
        ({"boxes": "coco"}, "boxes is 'coco', but must be auto, colour"),
        ({"boxes": "colour"}, "half_extent is None, but boxes by colour need"),
        ({"boxes": "colour", "robot": ["hand"]}, "robot is of boxes beside the videos"),
        ({"camera": "front"}, "is no LeRobot dataset"),
        ({"robot": "hand"}, r"a\.mp4: no boxes are beside the video"),
    ],
)
def test_options_that_are_wrong_are_named(tmp_path, options, words):
    push_video(tmp_path / "a.mp4", frames=2)
    with pytest.raises(DemoError, match=words):
        import_videos(tmp_path, **options)


def test_folders_of_videos_that_do_not_fit_are_refused_by_name(tmp_path):
    with pytest.raises(DemoError, match="holds no video"):
        colour(tmp_path)
    push_video(tmp_path / "a.mp4", frames=2)
    with pytest.raises(DemoError, match="half_extent is None"):
        colour(tmp_path, None)
    push_video(tmp_path / "b.mp4", fps=10.0, frames=2)
    with pytest.raises(DemoError, match=r"b\.mp4: has 10 frames per second, but a\.mp4 has 8"):
        colour(tmp_path)
    (tmp_path / "a.mov").write_bytes(b"")
    with pytest.raises(DemoError, match="two videos are called 'a'"):
        colour(tmp_path)
    assert not (tmp_path / "set").exists()


def test_a_video_of_odd_sides_is_found_by_colour(tmp_path):
    poses = [{"green square": (-0.5 + 0.1 * t, 0.5, 0.3)} for t in range(4)]
    frames = [scene(pose, side=257, smooth=True) for pose in poses]
    with av.open(str(tmp_path / "a.mp4"), "w") as out:
        stream = out.add_stream("libx264", rate=8)
        stream.width, stream.height, stream.pix_fmt = 257, 257, "yuv444p"
        for frame in frames:
            out.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        out.mux(stream.encode())
    made = colour(tmp_path)
    assert made[0].frames.shape[1:] == (256, 256, 3)
    (tmp_path / "set" / ".DS_Store").write_bytes(b"")  # as of a Mac that has shown the set
    assert colour(tmp_path) == made


def test_options_that_contradict_recordings_are_refused(tmp_path):
    (tmp_path / "a.pkl.gz").write_bytes(b"")
    with pytest.raises(DemoError, match=r"fps is 10, but the .* recordings in .* have 8 frames"):
        import_videos(tmp_path, fps=10.0)
    given = {"robot": "hand", "half_extent": 3.0, "outcome": "failure", "boxes": lambda film: []}
    for name, value in given.items():
        with pytest.raises(DemoError, match=f"{name} is given, but .* recordings: their objects"):
            import_videos(tmp_path, **{name: value})


def test_a_video_without_a_given_outcome_has_an_unknown_one():
    assert outcomes("success", ["a", "b"]) == {"a": "success", "b": "success"}
    assert outcomes({"b": "failure"}, ["a", "b"]) == {"a": "unknown", "b": "failure"}


def test_what_was_repaired_in_time_stamps_is_in_the_notes(tmp_path):
    rows = "".join(f"{t},cup,{5 + t},9,{15 + t},20\n{t},hand,30,5,40,45\n" for t in range(20))
    (tmp_path / "a.csv").write_text(f"frame,class,x_min,y_min,x_max,y_max\n{rows}")
    whole = odd_videos.encoded(tmp_path / "whole.mkv", options={"x264-params": "bframes=0"})
    same = lambda known: [*known[:9], (*known[8][:2], *known[9][2:]), *known[10:]]  # noqa: E731
    odd_videos.remuxed(tmp_path / "a.mkv", whole, same)
    whole.unlink()
    made = import_videos(tmp_path, robot="hand")
    assert len(made[0]) + made[0].trimmed == 20
    assert "\na: time stamps are wrong or missing at 1 of 20 frames, which were put" in made.notes


def test_a_video_in_which_nothing_but_the_hand_moves_is_doubtful(tmp_path):
    for name, speed in (("works", 1), ("waits", 0)):
        rows = "".join(
            f"{t},cup,{5 + speed * t},9,{15 + speed * t},20\n{t},hand,{t},5,{t + 9},45\n"
            for t in range(20)
        )
        (tmp_path / f"{name}.csv").write_text(f"frame,class,x_min,y_min,x_max,y_max\n{rows}")
        frames = [np.full((48, 64, 3), 9 * t, np.uint8) for t in range(20)]
        write_video(tmp_path / f"{name}.mp4", frames, 10.0)
    said = "doubtful: in waits nothing but hand moves, so only its first 6 frames are kept"
    with pytest.warns(UserWarning, match=said):
        made = gril.import_videos(tmp_path, robot=["hand"], progress=False)
    assert said in made.notes
    assert made.notes.count("doubtful") == 1


def test_a_set_may_have_the_rate_that_a_camera_just_misses(tmp_path):
    kitchen_films.write_films(tmp_path / "in", 1, fps=29.97, width=64, height=48, tempo=3.0)
    assert import_videos(tmp_path / "in", robot=["hand"], fps=30.0).fps == 30.0
    slow = import_videos(tmp_path / "in", robot=["hand"])[0].source  # at 10 frames a second
    assert slow.frame[:4].tolist() == [0, 3, 6, 9]
    np.testing.assert_allclose(slow.time, slow.frame / 29.97, atol=1e-3)


@pytest.mark.skipif(
    not (scenes.shared_data() / "magical").is_dir(), reason="no human demonstrations here"
)
def test_human_demonstrations_become_a_demo_set(tmp_path):
    source = scenes.shared_data() / "magical"
    (tmp_path / "in").mkdir()
    for number in ("004", "010"):
        name = f"demo-MatchRegions-Demo-v0-{number}.pkl.gz"
        (tmp_path / "in" / name).symlink_to(source / name)
    made = import_videos(tmp_path / "in", tmp_path / "set")
    loaded = load_demo_set(tmp_path / "set")
    assert (loaded.task, loaded.half_extent, loaded.fps) == ("match_regions", 1.02, 8.0)
    assert [entry.outcome for entry in loaded] == ["success", "success"]
    assert made == loaded
    for item, done in zip(made, (81, 98), strict=True):  # steps at which both are inside
        assert done <= len(item) <= done + 15
        assert len(item) + item.trimmed == 121
        assert item.tracks.seen.all()
    batch = demo_batch(loaded)
    assert batch.center.shape[2] == 7
    assert np.asarray(batch.is_robot).sum(1).tolist() == [1, 1]


def test_lengths_are_those_of_pictures_as_they_are_shown(tmp_path):
    """Of pixels that are half as wide as high: what moves as far to the right as down in pixels
    goes half as far to the right."""

    def narrow(stream):
        stream.codec_context.sample_aspect_ratio = Fraction(1, 2)

    odd_videos.encoded(tmp_path / "a.mp4", frames=20, prepare=narrow)
    rows = [
        (t, name, x, y, x + 8, y + 8, 1, "")
        for t in range(20)
        for name, x, y in (("cup", 2 * t, t), ("hand", 40, 2))
    ]
    kitchen_films.write_csv(tmp_path / "a.csv", rows)
    made = import_videos(tmp_path, robot=["hand"])
    way = made[0].tracks.center[-1, 0] - made[0].tracks.center[0, 0]
    np.testing.assert_allclose(way, [2 * 19 / 64, -2 * 19 / 64], atol=1e-6)
    np.testing.assert_allclose(made[0].tracks.size[0, 0], [8 / 64, 16 / 64], atol=1e-6)
    assert made[0].frames.shape[1:3] == (96, 64)
    assert "a: pixels are 0.5 times as wide as high; boxes count the stored 64 x 48" in made.notes


def test_a_video_shorter_than_a_step_is_refused(tmp_path):
    write_video(tmp_path / "a.mp4", [np.zeros((48, 64, 3), np.uint8)] * 2, 240.0)
    kitchen_films.write_csv(tmp_path / "a.csv", [(0, "cup", 1, 1, 9, 9, 1, "")])
    with pytest.raises(DemoError, match=r"a\.mp4: a lasts 0\.0042 s, but must last a step of the"):
        import_videos(tmp_path)
