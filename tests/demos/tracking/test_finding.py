"""Videos without boxes, and videos as telephones make them: detectors, time stamps."""

from fractions import Fraction

import av
import numpy as np
import pytest
from support.hostile import turned

from gril_jax.demos.own_detector import detecting
from gril_jax.demos.vision.timed import frames_of, look, nearest, part, pictures, steps
from gril_jax.demos.vision.video import write_video
from gril_jax.errors import DemoError

W, H, SIDE = 96, 64, 20


MINE = """
import numpy as np

def detect(frames):
    found = []
    for frame in frames:
        ys, xs = np.nonzero(frame[..., 2] < 50)
        found.append([("cup", xs.min(), ys.min(), xs.max() + 1, ys.max() + 1, 0.9)])
    return found

def short(frames): return []
def broken(frames): raise RuntimeError("no weights")
def odd(frames): return [[("cup", 1)] for _ in frames]
number = 3
"""


def test_a_detector_of_ones_own_is_called(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "my_detector.py").write_text(MINE)
    frames = []
    for t in range(40):  # more than a batch
        frames.append(np.full((H, W, 3), 200, np.uint8))
        frames[-1][20:40, 10 + t : 30 + t] = (200, 200, 0)
    write_video(tmp_path / "a.mp4", frames, 10.0)
    film = look(tmp_path / "a.mp4")
    found = detecting("my_detector:detect")(film)
    of_file = detecting(f"{tmp_path / 'my_detector.py'}:detect")(film)
    assert [one.edges for one in of_file] == [one.edges for one in found]
    assert len(found) == 40
    np.testing.assert_allclose(found[39].edges, [49, 20, 69, 40], atol=2)
    for name, words in {
        "my_detector": "must be FILE.py:FUNCTION, or module:function",
        "gone.py:detect": "the detector file gone.py does not exist",
        "my_detector:none": "cannot be imported",
        "no_such_module:detect": "cannot be imported",
        "my_detector:number": "must be a function",
        "my_detector:short": "gave boxes of 0 frames for 32",
        "my_detector:broken": "failed on a.mp4, frames 0 to 31 .RuntimeError: no weights",
        "my_detector:odd": "frame 0: a box must be class",
    }.items():
        with pytest.raises(DemoError, match=words):
            detecting(name)(film)


# --- time stamps


def uneven(path, stamps):
    """A video whose frames have these time stamps, in milliseconds; its shade is their number."""
    with av.open(str(path), "w", format="mp4") as out:
        stream = out.add_stream("libx264", rate=1000)
        stream.width, stream.height, stream.pix_fmt = W, H, "yuv420p"
        stream.codec_context.time_base = stream.time_base = Fraction(1, 1000)
        for number, stamp in enumerate(stamps):
            picture = np.full((H, W, 3), 40 + 8 * number, np.uint8)
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.pts, frame.time_base = stamp, Fraction(1, 1000)
            out.mux(stream.encode(frame))
        out.mux(stream.encode())


def test_a_film_of_no_constant_rate_is_taken_at_equal_steps_of_time(tmp_path):
    stamps = [0, 30, 60, 90, 300, 520, 740, 770, 800, 1000]
    uneven(tmp_path / "a.mp4", stamps)
    film = look(tmp_path / "a.mp4")
    np.testing.assert_allclose(film.times, np.array(stamps) / 1000, atol=2e-3)
    at = steps(film.times, 5.0)
    np.testing.assert_allclose(at, [0, 0.2, 0.4, 0.6, 0.8, 1.0])
    assert nearest(film.times, at).tolist() == [0, 4, 4, 5, 8, 9]
    shades = pictures(film, 5.0).mean(axis=(1, 2, 3))
    np.testing.assert_allclose(shades, 40 + 8 * np.array([0, 4, 4, 5, 8, 9]), atol=2)
    later = part(film, 0.3, 0.8, "later")
    np.testing.assert_allclose(later.times, [0, 0.22, 0.44, 0.47], atol=2e-3)
    shades = [frame.mean() for frame in frames_of(later)]
    np.testing.assert_allclose(shades, 40 + 8 * np.arange(4, 8), atol=2)


@pytest.mark.parametrize("codec", ["libx265", "libsvtav1", "libvpx-vp9"])
def test_films_of_other_codecs_are_read(tmp_path, codec):
    if codec not in av.codecs_available:
        pytest.skip(f"this PyAV has no {codec} to write with")
    with av.open(str(tmp_path / "a.mp4"), "w") as out:
        stream = out.add_stream(codec, rate=30)
        stream.width, stream.height, stream.pix_fmt = 64, 64, "yuv420p"
        for number in range(12):
            picture = np.full((64, 64, 3), 40 + 9 * number, np.uint8)
            out.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        out.mux(stream.encode())
    film = look(tmp_path / "a.mp4")
    assert len(film.times) == 12
    shades = pictures(film, 10.0).mean(axis=(1, 2, 3))
    np.testing.assert_allclose(shades, [40, 67, 94, 121], atol=3)


def test_a_film_that_was_held_upright_is_looked_at_upright(tmp_path):
    turned(tmp_path / "a.mp4")
    film = look(tmp_path / "a.mp4")
    assert (film.width, film.height) == (16, 32)
    assert pictures(film, 8.0).shape == (8, 32, 16, 3)


def test_a_large_film_is_made_smaller(tmp_path):
    write_video(tmp_path / "a.mp4", [np.zeros((500, 1000, 3), np.uint8)] * 3, 10.0)
    assert pictures(look(tmp_path / "a.mp4"), 10.0).shape == (3, 320, 640, 3)
