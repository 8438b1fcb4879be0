"""Folders of videos as disks, browsers and systems leave them."""

import pytest

from gril_jax.demos.folders import videos_in
from gril_jax.errors import DemoError


def filled(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"x")
    return folder


def test_what_systems_leave_in_a_folder_is_passed_over(tmp_path):
    filled(tmp_path, "a.mp4", "._a.mp4", ".hidden.mov", "Thumbs.db", ".DS_Store", "b.MTS", "a.csv")
    assert [path.name for path in videos_in(tmp_path, None)] == ["a.mp4", "b.MTS"]


@pytest.mark.parametrize(
    "name", ["b.mp4.part", "b.mp4.crdownload", ".b.mp4.icloud", "b.mp4.download/b.mp4"]
)
def test_a_video_that_has_not_come_yet_is_said(tmp_path, name):
    filled(tmp_path, "a.mp4", name)
    with pytest.raises(DemoError, match=r"b\.mp4 is not here as a whole yet; wait for it"):
        videos_in(tmp_path, None)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("inner/a.mp4", r"holds no video .*; there are videos in .*inner, which must be named"),
        ("data/meta/info.json", r"; a LeRobot dataset is in .*data, which must be named itself"),
        ("snapshots/abc/meta/info.json", r"; a LeRobot dataset is in .*snapshots/abc, which must"),
        ("._a.mp4", r"holds no video \(.*\)\.$"),
    ],
)
def test_a_folder_without_videos_says_where_some_are(tmp_path, name, words):
    with pytest.raises(DemoError, match=words):
        videos_in(filled(tmp_path, name), None)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("000.jpg", r"; there are pictures in .*, of which FFmpeg can make a video"),
        ("a/000.PNG", r"; there are pictures in .*a, of which"),
        ("videos.zip", r"; .*videos\.zip is packed, so unpack it"),
    ],
)
def test_pictures_and_packed_videos_are_said(tmp_path, name, words):
    with pytest.raises(DemoError, match=words):
        videos_in(filled(tmp_path, name), None)


def test_a_folder_must_be_one(tmp_path):
    with pytest.raises(DemoError, match=r"no: there is no such folder"):
        videos_in(tmp_path / "no", None)
    with pytest.raises(DemoError, match=r"a\.mp4: is a file; name the folder of the videos"):
        videos_in(filled(tmp_path, "a.mp4") / "a.mp4", None)
