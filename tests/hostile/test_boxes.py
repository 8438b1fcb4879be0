"""Files of a task's boxes that are broken or no files."""

import os

import pytest
from support.hostile import BOXES, COLUMNS, IMPORT, command, film, films, refused

ROW = "0,goal,0,0,8,8"
CSV = {
    "UTF-16": (BOXES.encode("utf-16"), "not text in UTF-8"),
    "Latin-1": (BOXES.replace("star", "stär").encode("latin-1"), "not text in UTF-8"),
    "semicolons": (BOXES.replace(",", ";"), "the format of the boxes is not known"),
    "tabs": (BOXES.replace(",", "\t"), "the format of the boxes is not known"),
    "nothing": ("", "the boxes file is empty"),
    "NUL bytes": (b"\0" * 4096, "the format of the boxes is not known"),
    "no size": (f"{COLUMNS}\n0,goal,nan,0,8,8\n", "x_min must be a number"),
    "endless": (f"{COLUMNS}\n0,goal,0,0,inf,8\n", "x_max must be a number"),
    "turned over": (f"{COLUMNS}\n0,goal,8,0,0,8\n", "x_min < x_max"),
    "beyond float32": (f"{COLUMNS}\n0,goal,-1e300,0,1e300,8\n", "x_min must be a number"),
    "below float32": (f"{COLUMNS}\n0,goal,0,0,1e-300,8\n", "above 0"),
    "twice": (f"{COLUMNS},track\n{ROW},1\n{ROW},1\n", "a second box of 'goal' 1 in frame 0"),
    "no class": (
        "frame,x_min,y_min,x_max,y_max\n0,0,0,8,8\n",
        "the format of the boxes is not known",
    ),
    "a formula": (f"{COLUMNS}\n0,=cmd|' /C calc'!A0,0,0,8,8\n", "class "),
    "one endless cell": (f"{COLUMNS}\n0,{'x' * 200_000},0,0,8,8\n", "not CSV text"),
    "a class of many letters": (f"{COLUMNS}\n0,{'x' * 100_000},0,0,8,8\n", "class "),
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


@pytest.mark.parametrize("given", [BOXES.replace("\n", "\r\n"), "\ufeff" + BOXES])
def test_boxes_with_other_line_ends_and_marks_are_read(home, capsys, given):
    film(films(home) / "a.mp4")
    (home / "films" / "a.csv").write_bytes(given.encode())
    argv = [*IMPORT, "--out", "new"]
    assert command(argv, capsys)[0] == 0
