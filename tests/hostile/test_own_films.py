"""Videos of one's own with wrong boxes, wrong options or wrong contents, on the command line.

Each is refused with exit code 2 in one sentence that names the file, with the line where there is
one, and nothing is half-written.
"""

import json
import os

import pytest
from support.hostile import BOXES, COLUMNS, IMPORT, command, film, films, refused
from support.wrong_boxes import NAMES, WRONG, H, W

from gril_jax.cli.main import main

OWN = ["demos", "import-videos", "films", "--robot", "hand", "--out", "new"]
HEAD = "frame,class,x_min,y_min,x_max,y_max"
ROWS = "".join(f"{t},cup,{9 + t},9,{40 + t},40\n{t},hand,90,5,130,45\n" for t in range(5))
GOOD = f"{HEAD}\n{ROWS}"


@pytest.fixture
def kitchen(home):
    """The user's folder with a video a.mp4 of five frames, and its boxes."""
    folder = films(home)
    film(folder / "a.mp4", ((H, W),) * 5)
    (folder / "a.csv").write_text(GOOD)
    return home


def test_what_is_right_is_imported(kitchen):
    assert main([*OWN, "--boxes", "auto"]) == 0


@pytest.mark.parametrize("kind", WRONG)
def test_wrong_boxes_are_refused(kitchen, capsys, kind):
    name, text, words = WRONG[kind]
    (kitchen / "films" / "a.csv").unlink()
    path = kitchen / "films" / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    if kind.startswith("YOLO"):
        (kitchen / "films" / "names.txt").write_text("\n".join(NAMES))
    assert refused(kitchen, [*OWN, "--boxes", "auto"], words, capsys) == 2


def boxes(rows, name="a.csv"):
    return lambda home: (home / "films" / name).write_text(rows)


def change(a, b):
    return boxes(GOOD.replace(a, b))


def another(name, **options):
    return lambda home: film(home / "films" / name, **options)


def gone(home):
    (home / "films" / "a.csv").unlink()


def one_frame(home):
    film(home / "films" / "a.mp4", ((H, W),))


def smaller(home):
    film(home / "films" / "a.mp4", ((16, 16),) * 5)


def outside(home):
    rows = "".join(f"{t},cup,900,9,940,40\n{t},hand,9,9,20,20\n" for t in range(5))
    (home / "films" / "a.csv").write_text(f"{HEAD}\n{rows}")


def several(home):
    more = "".join(f"{t},cup,150,60,170,80\n{t},cup 1,5,60,20,80\n" for t in range(5))
    (home / "films" / "a.csv").write_text(GOOD + more)


def shares(home):
    rows = "".join(f"{t},cup,0.1,0.1,0.2,0.3\n{t},hand,.5,.5,.7,1\n" for t in range(5))
    (home / "films" / "a.csv").write_text(f"{HEAD}\n{rows}")


def named(names):
    """MOTChallenge's form, with these names beside it."""

    def make(home):
        gone(home)
        (home / "films" / "a.txt").write_text("1,1,1,1,9,9,1,1\n2,1,1,1,9,9,1,2\n")
        (home / "films" / "names.txt").write_text(names)

    return make


def broken(home):
    (home / "broken_detector.py").write_text("def f(:\n")


def stopping(home):
    (home / "stopping_detector.py").write_text("import sys\ndef f(frames): sys.exit(0)\n")


AUTO = ("--boxes", "auto")
KINDS = {
    "no boxes": (gone, AUTO, "a.mp4: no boxes are beside the video"),
    "boxes twice": (boxes("1,1,1,1,9,9,1,cup", "a.txt"), AUTO, "both a.csv and a.txt are beside"),
    "a video of one frame": (one_frame, AUTO, "a.mp4: holds 1 frame, but a demonstration needs"),
    "a video of another size": (smaller, AUTO, "seem to be of a video of another size"),
    "another video without boxes": (another("b.mp4"), AUTO, "b.mp4: no boxes are beside the video"),
    "two videos of a name": (another("a.mov"), AUTO, "two videos are called 'a'"),
    "the robot's class is never seen": (
        change("hand", "spoon"), AUTO, "no box is of the robot's class 'hand'; the classes are cup"
    ),
    "nothing but the robot": (change("cup", "hand"), AUTO, "all classes are the robot's"),
    "boxes outside of the picture": (
        outside, AUTO, "lies outside"
    ),
    "a huge frame number": (boxes(f"{GOOD}{10**18},cup,1,1,9,9\n"), AUTO, "line 12: frame must be"),
    "a class with escapes": (boxes(f"{GOOD}0,cu\x1b[2Jp,1,1,9,9\n"), AUTO, "line 12"),
    "a class and one of several": (
        several,
        AUTO, "'cup 1' is a class, and also one of several of a class",
    ),
    "a class not of the task": (None, (*AUTO, "--task", "match_regions"), "line 2: class 'cup'"),
    "a frame in words": (change("\n3,cup", "\nthird,cup"), AUTO, "line 8: frame must be a whole"),
    "per cent": (change("3,cup,12,", "3,cup,12%,"), AUTO, "line 8: x_min must be a number, not"),
    "shares of the picture": (
        shares, AUTO, "line 2: all edges are at most 1, so the boxes seem to be shares"
    ),
    "no name of the robot": (None, (*AUTO, "--robot", ""), "no box is of the robot's class ''"),
    "boxes of a format's name": (None, ("--boxes", "coco"), "boxes is 'coco', but must be auto"),
    "jitter that is no number": (None, (*AUTO, "--jitter", "nan"), "--jitter is nan, but must be"),
    "endless width": (None, (*AUTO, "--half-extent", "inf"), "--half-extent is inf, but must be"),
    "a frame rate without end": (None, (*AUTO, "--fps", "1e9"), "--fps is 1000000000.0, but must"),
    "more frames than the video has": (
        None, (*AUTO, "--fps", "30"), "a.mp4: fps is 30, but the video has 8 frames a second, and a"
    ),
    "no names": (named(""), AUTO, "a.txt, line 1: class 1 is not among the 0 names of names.txt"),
    "names that are too few": (named("cup\n"), AUTO, "a.txt, line 2: class 2 is not among the 1"),
    "a name twice": (
        named("hand\n\nhand\n"), AUTO, "names.txt, line 3: 'hand' stands in line 1, too"
    ),
    "a detector with a mistake": (
        broken, ("--boxes", "broken_detector:f"), "cannot be imported (invalid syntax (broken"
    ),
    "a video that is no folder": (None, (*AUTO, "films/a.mp4"), "there is no use for"),
    "no width": (None, (*AUTO, "--half-extent", "0"), "--half-extent is 0.0"),
    "an even smoothing": (None, (*AUTO, "--smoothing", "4"), "--smoothing is 4, but must be odd"),
    "smoothing longer than a video": (
        None, (*AUTO, "--smoothing", "999"), "a.mp4: smoothing is 999 frames, but the video has 5"
    ),
    "an unknown outcome": (None, (*AUTO, "--outcome", "fine"), "outcome"),
    "a camera of no dataset": (None, (*AUTO, "--camera", "front"), "is no LeRobot dataset"),
    "a robot by colour": (
        None, ("--boxes", "colour", "--half-extent", "1"), "robot is of boxes beside the videos"
    ),
    "colours of no width": (None, ("--boxes", "colour"), "needs --half-extent where --boxes is"),
    "a detector without a function": (None, ("--boxes", "numpy"), "but must be auto, colour"),
    "a detector that is missing": (None, ("--boxes", "nowhere:f"), "cannot be imported"),
    "a detector that ends the program": (
        stopping, ("--boxes", "stopping_detector:f"), "frames 0 to 4 (it called sys.exit(0), in "
    ),
    "a detector that fails": (None, ("--boxes", "math:sqrt"), "failed on a.mp4, frames 0 to 4"),
    "a detector of another kind": (
        None, ("--boxes", "builtins:repr"), "for frames 0 to 4 of a.mp4; it must give a list"
    ),
    "boxes of a file": (None, ("--boxes", "t.json"), "boxes is 't.json', but must be auto"),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_wrong_films_and_options_are_refused(kitchen, capsys, kind):
    make, options, words = KINDS[kind]
    if make is not None:
        make(kitchen)
    assert refused(kitchen, [*OWN, *options], words, capsys) == 2


def test_names_that_are_paths_stay_names(kitchen):
    """Of classes and of videos within a file: nothing outside of the set is touched."""
    rows = GOOD.replace("cup", "../../cup").replace("hand", "/etc/hand")
    (kitchen / "films" / "a.csv").write_text(rows)
    before = sorted(path.name for path in kitchen.iterdir())
    argv = ["demos", "import-videos", "films", "--boxes", "auto", "--robot", "/etc/hand"]
    assert main([*argv, "--out", "new"]) == 0
    header = json.loads((kitchen / "new" / "demos.json").read_text())
    assert header["classes"] == ["../../cup", "/etc/hand"]
    assert sorted(path.name for path in kitchen.iterdir()) == sorted([*before, "new"])
    assert {path.name for path in (kitchen / "new").iterdir()} == {
        "000.mp4", "000.npz", "demos.json", "import.txt", "import.png"
    }  # fmt: skip


def test_after_a_refusal_the_corrected_command_runs(kitchen, capsys):
    gone(kitchen)
    refused(kitchen, [*OWN, *AUTO], "no boxes are beside the video", capsys)
    (kitchen / "films" / "a.csv").write_text(GOOD)
    assert main([*OWN, *AUTO]) == 0


ROW = "0,goal,0,0,8,8"
CSV = {
    "Latin-1": (BOXES.replace("star", "stär").encode("latin-1"), "not text in UTF-8"),
    "bars": (BOXES.replace(",", "|"), "the format of the boxes is not known"),
    "nothing": ("", "the boxes file is empty"),
    "NUL bytes": (b"\0" * 4096, "the format of the boxes is not known"),
    "no size": (f"{COLUMNS}\n0,goal,nan,0,8,8\n", "x_min must be a number"),
    "turned over": (f"{COLUMNS}\n0,goal,8,0,0,8\n", "x_min < x_max"),
    "beyond float32": (f"{COLUMNS}\n0,goal,-1e300,0,1e300,8\n", "x_min must be a number"),
    "below float32": (f"{COLUMNS}\n0,goal,0,0,1e-300,8\n", "above 0"),
    "twice": (
        f"{COLUMNS},track\n{ROW},1\n0,goal,8,8,16,16,1\n",
        "a second box of 'goal' 1 in frame 0",
    ),
    "a formula": (f"{COLUMNS}\n0,=cmd|' /C calc'!A0,0,0,8,8\n", "class "),
    "one endless cell": (f"{COLUMNS}\n0,{'x' * 200_000},0,0,8,8\n", "not CSV text"),
    "an open quote": (f'{COLUMNS}\n0,"goal,0,0,8,8\n', "2 cells where 6"),
    "a negative frame": (f"{COLUMNS}\n-1,goal,0,0,8,8\n", "whole number from 0"),
}


@pytest.mark.parametrize("kind", CSV)
def test_broken_boxes_are_refused(home, capsys, kind):
    given, words = CSV[kind]
    film(films(home) / "a.mp4")
    (home / "films" / "a.csv").write_bytes(given.encode() if isinstance(given, str) else given)
    argv = [*IMPORT, "--out", "new"]
    refused(home, argv, words, capsys)


@pytest.mark.parametrize("to", ["/dev/zero", "pipe", "a.csv", "gone.csv"])
def test_boxes_that_are_no_file_are_refused(home, capsys, to):
    folder = films(home)
    film(folder / "a.mp4")
    if to == "pipe":
        os.mkfifo(folder / "pipe")
    (folder / "a.csv").symlink_to(to)
    argv = [*IMPORT, "--out", "new"]
    refused(home, argv, "a.csv: the boxes file cannot be read", capsys)


@pytest.mark.parametrize(
    "given",
    [
        BOXES.replace("\n", "\r\n").encode(),
        ("\ufeff" + BOXES).encode(),
        BOXES.encode("utf-16"),
        BOXES.replace(",", ";").encode(),
    ],
)
def test_boxes_with_other_line_ends_and_marks_are_read(home, capsys, given):
    film(films(home) / "a.mp4")
    (home / "films" / "a.csv").write_bytes(given)
    argv = [*IMPORT, "--out", "new"]
    assert command(argv, capsys)[0] == 0
