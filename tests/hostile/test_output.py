"""Places for a demonstration set where it would harm, and names that no file can have."""

import io
import os
import sys

import pytest
from support.hostile import BOXES, COLUMNS, IMPORT, SET, command, film, films, refused

from gril_jax.cli.main import main


def overwrites_a_letter(home):
    return ["--out", "letter.txt"]


def holds_more(home):
    (home / "set" / "thesis.txt").write_text("years of work")
    return ["--out", "set"]


def is_the_source(home):
    (home / "films" / "a.mp4").rename(home / "set" / "a.mp4")
    return ["--out", "set"]


def dangles(home):
    (home / "new").symlink_to("elsewhere")
    return ["--out", "new"]


def loops(home):
    (home / "new").symlink_to("new")
    return ["--out", "new"]


OUTPUTS = {
    "a file": (overwrites_a_letter, "exists already"),
    "below a file": (lambda home: ["--out", "letter.txt/set"], "is a file"),
    "a set with a file of the user's": (holds_more, "thesis.txt"),
    "the folder of the videos": (lambda home: ["--out", "films"], "holds other files"),
    "a dangling link": (dangles, "exists already"),
    "a link to itself": (loops, "exists already"),
    "a long name": (lambda home: ["--out", "n" * 300], "too long"),
    "a long path": (lambda home: ["--out", "n/" * 3000], "too long"),
    "in a folder of the system's": (lambda home: ["--out", "/proc/new"], "/proc/new"),
    "the home itself": (lambda home: ["--out", "."], "holds other files"),
    "a run": (lambda home: ["--out", "run"], "holds other files"),
}


@pytest.mark.parametrize("kind", OUTPUTS)
def test_outputs_that_would_harm_are_refused(home, capsys, kind):
    film(films(home) / "a.mp4")
    (home / "films" / "a.csv").write_text(BOXES)
    make, words = OUTPUTS[kind]
    refused(home, IMPORT + make(home), words, capsys)


def test_a_set_is_not_replaced_by_what_is_read_from_it(home, capsys):
    argv = ["demos", "import-videos", "set", "--half-extent", "1", "--out", "./set"]
    refused(home, argv, "is read", capsys)


def test_a_link_to_a_set_keeps_its_place(home, capsys):
    film(films(home) / "a.mp4")
    (home / "films" / "a.csv").write_text(BOXES)
    (home / "link").symlink_to("set")
    assert command([*IMPORT, "--out", "link"], capsys)[0] == 0
    assert (home / "link").is_symlink()
    assert sorted(os.listdir(home)) == ["films", "letter.txt", "link", "run", "set"]
    assert sorted(os.listdir(home / "set")) == [*SET, "import.png", "import.txt"]


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_a_terminal_that_lacks_letters_shows_escapes(home, monkeypatch, encoding):
    film(films(home) / "a.mp4", ((48, 64),) * 5)
    rows = "".join(f"{t},\u676f,{9 + t},9,{20 + t},20\n{t},hand,30,5,40,45\n" for t in range(5))
    (home / "films" / "a.csv").write_text(f"{COLUMNS}\n{rows}", encoding="utf-8")
    raw = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(raw, encoding, "strict"))
    assert main(["demos", "import-videos", "films", "--robot", "hand", "--out", "new"]) == 0
    assert b"\\u676f" in raw.getvalue()


@pytest.mark.parametrize("verb", ["eval", "report", "export", "audit", "demos import-videos"])
def test_an_input_of_an_impossible_name_is_refused(home, capsys, verb):
    more = {"export": ["--out", "r.npz"]}
    more["demos import-videos"] = ["--out", "new", "--half-extent", "1"]
    refused(home, [*verb.split(), "n" * 5000, *more.get(verb, [])], "too long", capsys)


def test_a_run_in_a_folder_whose_name_is_no_text_is_refused_before_work(home, capsys):
    odd = os.fsdecode(b"caf\xe9")
    argv = ["pretrain", "--task", "none", "--demos", "set", "--out", f"{odd}/run"]
    refused(home, argv, "caf\\udce9/run is no text in UTF-8, but a run's folder must be", capsys)
    argv = ["check-task", f"{odd}/task.py:make"]
    refused(home, argv, "caf\\udce9/task.py:make' has letters that cannot be printed", capsys)
