"""Videos that cameras and tools write in other ways are shown as a player shows them."""

from fractions import Fraction

import av
import numpy as np
import pytest
from support.odd_videos import H, W, encoded

from gril_jax.demos.vision.timed import frames_of, look, pictures
from gril_jax.demos.vision.video import read_video
from gril_jax.errors import DemoError


def corner(number):
    """A picture that is bright at the top left, and half as bright at the top right."""
    picture = np.full((H, W, 3), 10, np.uint8)
    picture[: H // 2, : W // 2] = 240
    picture[: H // 2, W // 2 :] = 120
    return picture


def corners(picture):
    """The brightness of the corners, row by row, in tens."""
    h, w = picture.shape[0] // 4, picture.shape[1] // 4
    return [round(picture[y, x].mean() / 120) for y in (h, -h) for x in (w, -w)]


@pytest.mark.parametrize(
    ("degrees", "mirrored", "found"),
    [
        (0, False, [2, 1, 0, 0]),
        (0, True, [1, 2, 0, 0]),
        (180, False, [0, 0, 1, 2]),
        (180, True, [0, 0, 2, 1]),  # mirrored from top to bottom
        (90, False, [1, 0, 2, 0]),
        (-90, False, [0, 2, 0, 1]),
        (90, True, [0, 1, 0, 2]),
        (-90, True, [2, 0, 1, 0]),
    ],
)
def test_pictures_are_turned_and_mirrored_as_the_file_says(tmp_path, degrees, mirrored, found):
    turn = lambda stream: stream.set_display_rotation(degrees, hflip=mirrored)  # noqa: E731
    path = encoded(tmp_path / "a.mp4", pictures=corner, frames=3, prepare=turn)
    film = look(path)
    assert (film.width, film.height) == ((H, W) if degrees in (90, -90) else (W, H))
    assert corners(next(frames_of(film))) == found
    assert corners(read_video(path)[0]) == found


def test_a_picture_to_be_turned_by_less_than_a_quarter_is_refused(tmp_path):
    turn = lambda stream: stream.set_display_rotation(30)  # noqa: E731
    path = encoded(tmp_path / "a.mp4", frames=3, prepare=turn)
    with pytest.raises(
        DemoError, match=r"a\.mp4: is to be shown aslant, turned by (29|30) degrees, but must"
    ):
        look(path)


def test_a_cover_is_no_video(tmp_path):
    """The picture that music players show, which some tools put before the video itself."""
    with av.open(str(tmp_path / "a.mp4"), "w") as out:
        cover = out.add_stream("mjpeg", rate=10)
        cover.width, cover.height, cover.pix_fmt = 32, 32, "yuvj420p"
        cover.disposition = av.stream.Disposition.attached_pic
        stream = out.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = W, H, "yuv420p"
        still = av.VideoFrame.from_ndarray(np.zeros((32, 32, 3), np.uint8), format="rgb24")
        out.mux(cover.encode(still.reformat(format="yuvj420p")))
        out.mux(cover.encode())
        for number in range(5):
            out.mux(stream.encode(av.VideoFrame.from_ndarray(corner(number), format="rgb24")))
        out.mux(stream.encode())
    film = look(tmp_path / "a.mp4")
    assert (len(film.times), film.width) == (5, W)


def test_a_codec_without_a_decoder_is_a_sentence(tmp_path):
    path = encoded(tmp_path / "a.avi", "mpeg4", 3)
    path.write_bytes(path.read_bytes().replace(b"FMP4", b"ZZZZ"))
    with pytest.raises(DemoError, match=r"a\.avi: FFmpeg has no decoder for the codec"):
        look(path)


def test_a_pointer_of_git_lfs_is_told_from_a_damaged_video(tmp_path):
    text = "version https://git-lfs.github.com/spec/v1\noid sha256:1\nsize 9\n"
    (tmp_path / "a.mp4").write_text(text)
    with pytest.raises(DemoError, match=r"a\.mp4: not the video but a Git LFS pointer"):
        look(tmp_path / "a.mp4")


def test_a_link_that_was_copied_as_text_is_said(tmp_path):
    (tmp_path / "a.mp4").write_text("../../blobs/0123")
    with pytest.raises(DemoError, match=r"the text of a link to it, \.\./\.\./blobs/0123; copy"):
        look(tmp_path / "a.mp4")


@pytest.mark.parametrize(
    ("name", "codec", "options"),
    [
        ("a.mkv", "libx264", {}),
        ("a.webm", "libvpx", {}),
        ("a.avi", "mpeg4", {}),
        ("a.mp4", "libx264", {"movflags": "faststart"}),
    ],
)
def test_a_file_that_was_cut_short_is_refused_wherever_its_index_lies(
    tmp_path, name, codec, options
):
    noise = np.random.default_rng(0).integers(0, 255, (20, H, W, 3)).astype(np.uint8)
    path = tmp_path / name
    with av.open(str(path), "w", options=options) as out:
        stream = out.add_stream(codec, rate=10)
        stream.width, stream.height, stream.pix_fmt = W, H, "yuv420p"
        for picture in noise:
            out.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        out.mux(stream.encode())
    data = path.read_bytes()
    assert len(look(path).times) == 20
    path.write_bytes(data + b"\0" * 100)  # what a maker of telephones adds does no harm
    assert len(look(path).times) == 20
    path.write_bytes(data[: 2 * len(data) // 3])
    with pytest.raises(DemoError, match="not a whole video file"):
        look(path)


def test_of_several_videos_in_a_file_the_first_counts_and_it_is_said(tmp_path):
    with av.open(str(tmp_path / "a.mp4"), "w") as out:
        streams = [out.add_stream("libx264", rate=10) for _ in range(2)]
        for stream, width in zip(streams, (W, 2 * W), strict=True):
            stream.width, stream.height, stream.pix_fmt = width, H, "yuv420p"
        for _ in range(3):
            for stream in streams:
                picture = np.zeros((H, stream.width, 3), np.uint8)
                out.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        for stream in streams:
            out.mux(stream.encode())
    film = look(tmp_path / "a.mp4")
    assert (film.width, film.note) == (W, "the file holds 2 videos, of which the first counts")


@pytest.mark.parametrize(
    ("ratio", "turned", "size", "found"),
    [
        (Fraction(4, 3), 0, (W, H), 4 / 3),
        (Fraction(1, 2), 0, (W, H), 0.5),
        (Fraction(4, 3), 90, (H, W), 3 / 4),
        (Fraction(4319, 4320), 0, (W, H), 1.0),
    ],
)
def test_pictures_are_as_wide_as_they_are_shown(tmp_path, ratio, turned, size, found):
    """Boxes count the pixels that are stored, which detectors and CVAT see."""

    def stretched(stream):
        stream.codec_context.sample_aspect_ratio = ratio
        if turned:
            stream.set_display_rotation(turned)

    path = encoded(tmp_path / "a.mp4", frames=3, pictures=corner, prepare=stretched)
    film = look(path)
    assert (film.width, film.height) == size
    assert film.aspect == pytest.approx(found)
    assert ("boxes count the stored" in str(film.note)) == (found != 1)
    assert next(frames_of(film)).shape[:2] == size[::-1]
    shown = pictures(film, 10.0)[0]
    assert shown.shape[1] / shown.shape[0] == pytest.approx(size[0] * found / size[1], rel=0.04)
    whole = read_video(path)[0]
    assert whole.shape[1] / whole.shape[0] == pytest.approx(size[0] * found / size[1], rel=0.04)
    assert corners(whole) == corners(next(frames_of(film)))
