"""Time stamps: in order, a few wrong, or useless; and frames that a file has but nobody sees."""

from pathlib import Path

import numpy as np
import pytest
from support.odd_videos import cut_at_open_group, encoded, remuxed

from gril_jax.demos.vision.stamps import Packet, _lost, in_order
from gril_jax.demos.vision.timed import frames_of, look, part
from gril_jax.demos.vision.video import read_video
from gril_jax.errors import DemoError


def shades(film):
    """The numbers of the frames, by their shades."""
    return [round((frame.mean() - 40) / 4) for frame in frames_of(film)]


@pytest.mark.parametrize(
    ("at", "stamp", "becomes"),
    [(10, 9, 10.0), (10, None, 10.0), (10, 3, 10.0), (0, None, 0.0), (19, 2, 19.0), (10, 900, 10)],
)
def test_a_wrong_stamp_goes_between_its_neighbours(at, stamp, becomes):
    stamps = [*range(20)]
    stamps[at] = stamp
    found, bad = in_order(stamps)
    assert bad == 1
    assert found == [*range(at), becomes, *range(at + 1, 20)]


@pytest.mark.parametrize("stamps", [[0] * 20, [None] * 20, [*range(10), *range(10)], []])
def test_useless_stamps_are_no_times(stamps):
    assert in_order(stamps) == (None if stamps else [], len(stamps) - len({*stamps} - {None}))


def changing(at, to):
    """Packets of which one has another time stamp."""

    def change(known):
        known[at] = (to(known), to(known), *known[at][2:])
        return known

    return change


FLAT = {"x264-params": "bframes=0"}


def test_a_repeated_stamp_is_repaired_and_said(tmp_path):
    whole = encoded(tmp_path / "whole.mkv", options=FLAT)
    film = look(remuxed(tmp_path / "a.mkv", whole, changing(11, lambda known: known[10][0])))
    np.testing.assert_allclose(film.times, np.arange(20) / 10, atol=2e-3)
    assert film.note.startswith(
        "time stamps are wrong or missing at 1 of 20 frames, which were put"
    )
    assert shades(film) == [*range(20)]


def test_useless_stamps_give_way_to_the_constant_rate(tmp_path):
    whole = encoded(tmp_path / "whole.mkv", options=FLAT)
    same = lambda known: [(0, 0, *one[2:]) for one in known]  # noqa: E731
    film = look(remuxed(tmp_path / "a.mkv", whole, same))
    assert len(film.times) == 20
    assert "so the file's constant rate of" in film.note
    assert shades(film) == [*range(20)]


@pytest.mark.parametrize("codec", ["libx265", "libx264"])
def test_pictures_before_the_first_whole_one_are_passed_over(tmp_path, codec):
    path = cut_at_open_group(tmp_path / "a.mkv", codec)
    film = look(path)
    seen = shades(film)
    assert seen == [*range(seen[0], 30)]
    assert len(film.times) == len(seen) == len(read_video(path)) == 18
    assert film.note.startswith("before its first whole picture 2 cannot be decoded and are passed")


def test_leading_pictures_may_have_no_stamp():
    """As Matroska leaves those that would be before 0; others must not be lost."""
    stamps = [0, None, None, 133, 67, 33, 100]
    packets = [Packet(stamp, None, not at) for at, stamp in enumerate(stamps)]
    assert _lost(Path("a.mkv"), packets, [0, 33, 67, 100, 133]) == 2
    with pytest.raises(DemoError, match=r"a\.mkv: 4 of 7 frames could be read; the file is cut"):
        _lost(Path("a.mkv"), packets, [0, 33, 67, 100])


@pytest.mark.parametrize("codec", ["libx265", "libx264"])
@pytest.mark.parametrize("at", [0, 5, 19])
def test_damage_is_an_error_also_at_the_beginning(tmp_path, codec, at):
    options = {"x265-params": "keyint=5:bframes=0:log-level=none"} if codec == "libx265" else FLAT
    whole = encoded(tmp_path / "whole.mkv", codec, options=options | {"g": "5"})

    def damaged(known):
        known[at] = (*known[at][:3], known[at][3][:6] + b"\0" * 40)
        return known

    path = remuxed(tmp_path / "a.mkv", whole, damaged)
    for read in (lambda: shades(look(path)), lambda: read_video(path)):
        with pytest.raises(DemoError, match=r"a\.mkv: "):
            read()


def test_a_recording_that_begins_within_a_group_is_read_from_its_first_key_frame(tmp_path):
    whole = encoded(tmp_path / "whole.ts", frames=30, options=FLAT | {"g": "10"})
    film = look(remuxed(tmp_path / "a.ts", whole, lambda known: known[4:]))
    seen = shades(film)
    assert seen == [*range(seen[0], 30)]
    assert len(film.times) == len(seen) >= 20


def test_pictures_of_vp8_that_are_never_shown_are_no_frames(tmp_path):
    options = {"auto-alt-ref": "1", "lag-in-frames": "16", "deadline": "good", "b": "200k"}
    path = encoded(tmp_path / "a.webm", "libvpx", 40, options=options)
    film = look(path)
    assert len(film.times) == len(shades(film)) == 40


def test_an_episode_is_found_in_a_file_that_does_not_begin_at_0(tmp_path):
    whole = encoded(tmp_path / "whole.mkv", options=FLAT | {"g": "5"})
    later = lambda known: [(pts + 700, dts + 700, *one) for pts, dts, *one in known]  # noqa: E731
    film = look(remuxed(tmp_path / "a.mkv", whole, later))
    assert film.times[0] == 0
    assert shades(part(film, 0.8, 1.2, "later")) == [8, 9, 10, 11]


def test_a_film_without_stamps_counts_at_its_rate(tmp_path):
    path = encoded(tmp_path / "a.avi", "libx264")  # AVI has none, and pictures are out of order
    film = look(path)
    np.testing.assert_allclose(film.times, np.arange(20) / 10, atol=2e-3)
    assert shades(film) == [*range(20)]
