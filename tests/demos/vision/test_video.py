"""Frames to files and back."""

import builtins
import errno

import numpy as np
import pytest
from support.scenes import BLOCKS, scene

from gril_jax.demos.vision.video import read_fps, read_video, write_video
from gril_jax.errors import DemoError


@pytest.fixture
def frames():
    x, y, angle = BLOCKS["green square"]
    return np.stack([scene({"green square": (x + 0.05 * t, y, angle)}, side=128) for t in range(6)])


def test_round_trip_keeps_shape_rate_order_and_nearly_every_level(tmp_path, frames):
    write_video(tmp_path / "a.mp4", iter(frames), 8.0)
    back = read_video(tmp_path / "a.mp4")
    assert back.shape == frames.shape
    assert back.dtype == np.uint8
    assert read_fps(tmp_path / "a.mp4") == 8.0
    error = np.abs(back.astype(int) - frames).mean(axis=(1, 2, 3))
    assert error.max() < 2.0
    swapped = np.abs(back[::-1].astype(int) - frames).mean(axis=(1, 2, 3))
    assert (swapped > error).all()


def test_colours_stay_in_rgb_order(tmp_path):
    frames = np.zeros((3, 64, 64, 3), np.uint8)
    frames[..., 0], frames[..., 2] = 220, 40
    write_video(tmp_path / "a.mp4", frames, 8.0)
    assert np.abs(read_video(tmp_path / "a.mp4").astype(int) - frames).max() <= 4


def test_pixels_are_stored_as_browsers_expect(tmp_path, frames):
    import av

    write_video(tmp_path / "a.mp4", frames, 8.0)
    with av.open(str(tmp_path / "a.mp4")) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")


def test_writing_leaves_no_other_file_and_replaces_the_old_one(tmp_path, frames):
    write_video(tmp_path / "a.mp4", frames, 8.0)
    write_video(tmp_path / "a.mp4", frames[:2], 8.0)
    assert [p.name for p in tmp_path.iterdir()] == ["a.mp4"]
    assert len(read_video(tmp_path / "a.mp4")) == 2


@pytest.mark.parametrize(
    ("name", "sizes", "fps", "words"),
    [
        ("a.mp4", [], 8.0, "at least 1 frame"),
        ("a.mp4", [(9, 8)], 8.0, "even sizes"),
        ("a.mp4", [(8, 8), (8, 10)], 8.0, "one size"),
        ("a.mp4", [(8, 8)], 0.0, "frame rate above 0"),
        ("nowhere/a.mp4", [(8, 8)], 8.0, r"nowhere/a\.mp4: .*No such file"),
    ],
)
def test_unfit_frames_rates_and_places_are_refused_and_leave_nothing(
    tmp_path, name, sizes, fps, words
):
    with pytest.raises(DemoError, match=words):
        write_video(tmp_path / name, [np.zeros((*size, 3), np.uint8) for size in sizes], fps)
    assert list(tmp_path.iterdir()) == []


def test_a_failing_source_of_frames_leaves_the_old_video(tmp_path, frames):
    write_video(tmp_path / "a.mp4", frames, 8.0)

    def broken():
        yield frames[0]
        raise DemoError("the source broke.")

    with pytest.raises(DemoError, match="the source broke"):
        write_video(tmp_path / "a.mp4", broken(), 8.0)
    assert [p.name for p in tmp_path.iterdir()] == ["a.mp4"]
    assert len(read_video(tmp_path / "a.mp4")) == len(frames)


def test_a_full_disk_is_one_sentence_and_leaves_no_part(tmp_path, frames, monkeypatch):
    def open_on_full_disk(path, mode="r", *args, **kwargs):
        file = builtins.open(path, mode, *args, buffering=0)
        if "w" not in mode:
            return file

        class Full:
            def write(self, data):
                raise OSError(errno.ENOSPC, "No space left on device")

            def __enter__(self):
                return self

            def __exit__(self, *_):
                file.close()

            def __getattr__(self, name):
                return getattr(file, name)

        return Full()

    monkeypatch.setattr("gril_jax.demos.vision.video.open", open_on_full_disk, raising=False)
    with pytest.raises(DemoError, match=r"a\.mp4: .* because there is no space left \("):
        write_video(tmp_path / "a.mp4", frames, 8.0)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.95])
def test_a_video_cut_short_is_refused(tmp_path, frames, share):
    write_video(tmp_path / "a.mp4", frames, 8.0)
    whole = (tmp_path / "a.mp4").read_bytes()
    (tmp_path / "cut.mp4").write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(DemoError, match=r"cut\.mp4"):
        read_video(tmp_path / "cut.mp4")


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"", "empty"), (b"hello, world\n" * 100, "not a whole video"), (None, "no such video")],
)
def test_empty_foreign_and_missing_files_are_refused(tmp_path, content, words):
    if content is not None:
        (tmp_path / "a.mp4").write_bytes(content)
    for read in (read_video, read_fps):
        with pytest.raises(DemoError, match=words):
            read(tmp_path / "a.mp4")
