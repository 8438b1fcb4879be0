"""A detector of the user's own that sees nothing, fails, ends the program or gives other things."""

import re
import sys

import numpy as np
import pytest
from support.odd_videos import encoded

from gril_jax.demos.formats.fit import require_told_apart
from gril_jax.demos.own_detector import detecting
from gril_jax.demos.vision.timed import look, part
from gril_jax.errors import DemoError

THEIRS = """
import sys
CUP = ("cup", 9, 9, 40, 40)
def some(frames): return [None if k == 2 else [CUP] for k in range(len(frames))]
def none(frames): return [None] * len(frames)
def nothing(frames): return None
def stops(frames): sys.exit("no weights")
def ends(frames): sys.exit(0)
def later(frames):
    for k in range(len(frames)):
        yield [CUP] if k < 3 else [("cup", 1 / 0)]
def number(frames): return [3] * len(frames)
def named(frames): return {"cup": CUP}
def flat(frames): return [CUP] * len(frames)
def classes(frames): return [[(7, 9, 9, 40, 40)]] * len(frames)
def endless(frames):
    while True: yield []
def talks(frames): raise ValueError("one\\n" * 500)
"""


@pytest.fixture
def film(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "theirs.py").write_text(THEIRS)
    (tmp_path / "gone.py").write_text("import sys\nsys.exit(0)\n")
    (tmp_path / "fails.py").write_text("x = 1\ny = {}['weights']\n")
    for name in ("theirs", "gone", "fails"):
        sys.modules.pop(name, None)
    return look(encoded(tmp_path / "a.mp4", frames=6))


def test_none_is_no_box(film):
    found = detecting("theirs:some")(film)
    assert [one.frame for one in found] == [0, 1, 3, 4, 5]


WRONG = {
    "theirs:none": r"theirs:none \(.*theirs.py, line 5\): found no box in any of the 6 frames of a",
    "theirs:nothing": r"nothing \(.*theirs.py, line 6\): gave None for frames 0 to 5 of a.mp4; it",
    "theirs:stops": r"failed on a.mp4, frames 0 to 5 \(it called sys.exit\('no weights'\), in .*"
    r"theirs.py, line 7\)",
    "theirs:ends": r"it called sys.exit\(0\), in .*theirs.py, line 8\)",
    "theirs:later": r"failed on a.mp4, frame 3 \(ZeroDivisionError: .*, in .*theirs.py, line 11\)",
    "theirs:number": r"number \(.*theirs.py, line 12\), a.mp4, frame 0: boxes must be a list.* 3",
    "theirs:classes": r"line 15\), a.mp4, frame 0: a class must be a name .*, not 7",
    "theirs:endless": r"gave boxes of more than 6 frames for 6 of a.mp4; it must give a list for",
    "theirs:named": r"gave {'cup': .* for frames 0 to 5 of a.mp4; it must give a list",
    "theirs:flat": r"flat \(.*line 14\), a.mp4, frame 0: a box must be class, .*, not 'cup'",
    "theirs:talks": r"ValueError: one one one",
    "gone:detect": r"gone:detect cannot be imported \(it called sys.exit\(0\), in .*gone.py, line",
    "fails:detect": r"fails:detect cannot be imported \(KeyError: 'weights', in .*fails.py, line 2",
}


@pytest.mark.parametrize("name", WRONG)
def test_what_a_detector_does_wrong_is_one_sentence(film, name):
    with pytest.raises(DemoError) as raised:
        detecting(name)(film)
    said = str(raised.value)
    assert re.search(WRONG[name], said), said
    assert "\n" not in said
    assert len(said) < 600


def test_boxes_of_a_frame_may_come_one_by_one(film):
    one = ("cup", np.float32(9), 9, 40, 40)
    assert len(detecting(lambda frames: ((box for box in [one]) for _ in frames))(film)) == 6


def test_two_videos_in_one_file_are_told_apart(film):
    """As episodes of a LeRobot dataset are."""
    half = film.times[3]
    films = [part(film, 0.0, half, "one"), part(film, half, 99.0, "two")]
    boxes = [
        detecting(lambda frames: [[("cup", 9, 9, 40, 40)]] * len(frames))(each) for each in films
    ]
    require_told_apart(films, boxes)
    assert all(boxes)
