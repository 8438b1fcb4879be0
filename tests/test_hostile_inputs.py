"""Hostile and broken inputs end in one sentence, or work right; nothing runs and nothing is lost.

A case builds its files below a folder and returns a command line. Whatever the command does, what
was there before is there afterwards, and what is new lies in the output folder.
"""

import gzip
import hashlib
import json
import os
import pickle
import signal
import zipfile

import numpy as np
import pytest
from support.hostile_films import BOXES, COLUMNS, archive, bomb, changing, film, npy, sound, turned
from support.pickled_code import Writes
from support.run_folders import save_demos, save_run

from gril_jax.cli.main import main
from gril_jax.demos.vision import video

SECONDS = 30  # after which a command counts as hanging
HUGE = (1 << 50,)
DEEP = "[" * 20_000
ONE = (16, 16)


@pytest.fixture(scope="module")
def honest(tmp_path_factory):
    """A folder with a small demonstration set and a small run, of which tests take copies."""
    base = tmp_path_factory.mktemp("honest")
    save_demos(base / "set", names=("one", "two"))
    save_run(base / "run", pretrain=1, ppo=0)
    return base


@pytest.fixture
def home(tmp_path, honest, monkeypatch):
    """The user's folder: copies of the honest ones, and a file that must stay as it is."""
    os.system(f"cp -r {honest} {tmp_path / 'home'}")
    (tmp_path / "home" / "letter.txt").write_text("dear reader\n" * 100)
    monkeypatch.chdir(tmp_path / "home")
    return tmp_path / "home"


def contents(folder):
    """Every path below a folder, with the digest of a file and the target of a link."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = os.fsencode(path.relative_to(folder))
        if path.is_symlink():
            found[name] = os.readlink(path)
        elif path.is_file():
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
        else:
            found[name] = path.is_dir()
    return found


def command(argv, capsys):
    """The exit code and standard error of a command line, which must not hang."""

    def hangs(*_):
        raise AssertionError(f"the command hangs: {argv}")

    before = signal.signal(signal.SIGALRM, hangs)
    signal.alarm(SECONDS)
    try:
        code = main(argv)
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
    return code, capsys.readouterr().err


def refused(home, argv, words, capsys):
    """A command ends in one sentence with these words, and leaves all as it was."""
    before = contents(home)
    code, said = command(argv, capsys)
    assert code in (1, 2), (code, said)
    last = said.strip().splitlines()[-1]
    assert last.startswith("gril: "), said
    assert last.endswith("."), said
    assert said.count("gril: ") == 1, said
    assert "Traceback" not in said
    assert len(last) < 1200, last
    assert words in said, said
    assert contents(home) == before


# --- films


def films(home):
    folder = home / "films"
    folder.mkdir()
    return folder


def empty(folder):
    (folder / "a.mp4").touch()


def cut(folder):
    whole = film(folder / "a.mp4", codec="libx264").read_bytes()
    (folder / "a.mp4").write_bytes(whole[: len(whole) // 2])


def text(words, name="a.mp4"):
    return lambda folder: (folder / name).write_text(words)


def playlist(folder):
    """What FFmpeg would follow to other files."""
    film(folder / "b.ts", container="mpegts")
    (folder / "a.mp4").write_text("#EXTM3U\n#EXTINF:1,\nb.ts\n#EXT-X-ENDLIST\n")


def list_of_films(folder):
    (folder / "a.mp4").write_text("ffconcat version 1.0\nfile b.mp4\n")
    film(folder / "b.mp4")


def damaged(folder):
    film(folder / "a.mp4")
    data = (folder / "a.mp4").read_bytes()
    (folder / "b.mp4").write_bytes(data.replace(b"mdhd", b"mdhx"))


FILMS = {
    "nothing": (lambda folder: None, "the folder holds no video"),
    "no bytes": (empty, "is empty (0 bytes)"),
    "one frame": (lambda f: film(f / "a.mp4", (ONE,)), "at least 2 frames, not 1"),
    "another size on its way": (lambda f: changing(f / "a.mp4"), "a.mp4: "),
    "cut in the middle": (cut, "a.mp4: not a whole video"),
    "no pictures": (lambda f: sound(f / "a.mp4"), "holds no video stream"),
    "HTML": (text("<html><script>alert(1)</script>"), "not a whole video"),
    "a playlist of other files": (playlist, "not a whole video"),
    "a list of other films": (list_of_films, "a.mp4: not a whole video"),
    "a session description": (text("v=0\nc=IN IP4 127.0.0.1\nm=video 9 RTP/AVP 96\n"), "not a"),
    "a damaged header": (damaged, "b.mp4: "),
    "a folder with its name": (lambda f: (f / "a.mp4").mkdir(), "no such video file"),
    "a dangling link": (lambda f: (f / "a.mp4").symlink_to("gone.mp4"), "no such video file"),
    "a link to itself": (lambda f: (f / "a.mp4").symlink_to("a.mp4"), "no such video file"),
    "a link to a device": (lambda f: (f / "a.mp4").symlink_to("/dev/zero"), "no such video file"),
    "a pipe": (lambda f: os.mkfifo(f / "a.mp4"), "no such video file"),
    "a link to a text": (lambda f: (f / "a.mp4").symlink_to("../letter.txt"), "not a whole video"),
    "two of one name": (
        lambda f: (film(f / "a.mp4"), film(f / "a.mov")),
        "two videos are called 'a'",
    ),
    "a name that is a protocol": (text("", "concat:a.mp4|b.mp4"), "is empty"),
}  # fmt: skip


@pytest.mark.parametrize("kind", FILMS)
def test_a_folder_of_broken_films_is_refused(home, capsys, kind):
    make, words = FILMS[kind]
    make(films(home))
    for name in "ab":
        (home / "films" / f"{name}.csv").write_text(BOXES)
    boxes = ["--boxes", "True"]
    argv = ["demos", "import-videos", "films", "--half-extent", "1", "--out", "new", *boxes]
    refused(home, argv, words, capsys)


def test_a_film_that_would_fill_the_memory_is_refused(home, capsys, monkeypatch):
    film(films(home) / "a.mp4", (ONE,) * 100)
    monkeypatch.setattr(video, "_memory", lambda: 100_000)
    argv = ["demos", "import-videos", "films", "--half-extent", "1", "--out", "new"]
    refused(home, argv, "more than half of this machine's memory", capsys)


NAMES = {
    "spaces": "my first film",
    "a newline": "one\ntwo",
    "other scripts": "фильм 映画 🎬",
    "markup": "<script>alert(1)<script>",
    "a shell": "$(touch run) ; touch run",
    "an option": "--out",
    "a pattern": "%03d",
    "a protocol": "http:x",
    "a long one": "n" * 240,
    "dots": "...",
}


@pytest.mark.parametrize("kind", NAMES)
def test_a_film_may_have_any_name(home, capsys, kind):
    folder = films(home)
    film(folder / f"{NAMES[kind]}.mp4")
    (folder / f"{NAMES[kind]}.csv").write_text(BOXES)
    os.chdir(folder)
    before = contents(home)
    argv = [
        "demos",
        "import-videos",
        ".",
        "--half-extent",
        "1",
        "--boxes",
        "True",
        "--out",
        "../new",
    ]
    code, said = command(argv, capsys)
    assert code == 0, said
    after = {k: v for k, v in contents(home).items() if k.split(b"/")[0] != b"new"}
    assert after == before
    header = json.loads((home / "new" / "demos.json").read_text())
    assert [entry["name"] for entry in header["demos"]] == [NAMES[kind]]
    assert sorted(os.listdir(home / "new")) == ["000.mp4", "000.npz", "demos.json"]


@pytest.mark.slow
def test_ten_thousand_tiny_frames_are_read(home, capsys):
    film(films(home) / "a.mp4", (ONE,) * 10_000)
    (home / "films" / "a.csv").write_text(BOXES)
    argv = [
        "demos",
        "import-videos",
        "films",
        "--half-extent",
        "1",
        "--boxes",
        "True",
        "--out",
        "new",
    ]
    assert command(argv, capsys)[0] == 0
    header = json.loads((home / "new" / "demos.json").read_text())
    assert header["demos"][0]["frames"] + header["demos"][0]["trimmed"] == 10_000


def test_another_container_under_this_name_and_a_turned_film_are_read(home):
    folder = films(home)
    film(folder / "a.mp4", container="matroska")
    assert video.read_video(folder / "a.mp4").shape == (8, 16, 16, 3)
    turned(folder / "b.mp4")
    assert video.read_video(folder / "b.mp4").shape == (8, 32, 16, 3)


def test_a_name_that_is_no_text_is_refused(home, capsys):
    folder = os.fsencode(films(home))
    film(home / "films" / "a.mp4")
    os.rename(folder + b"/a.mp4", folder + b"/\xff.mp4")
    argv = ["demos", "import-videos", "films", "--half-extent", "1", "--out", "new"]
    refused(home, argv, "is not text in UTF-8", capsys)


# --- boxes

ROW = "0,goal,0,0,8,8"
CSV = {
    "UTF-16": (BOXES.encode("utf-16"), "not CSV text in UTF-8"),
    "Latin-1": (BOXES.replace("star", "stär").encode("latin-1"), "not CSV text in UTF-8"),
    "semicolons": (BOXES.replace(",", ";"), "the columns must be"),
    "tabs": (BOXES.replace(",", "\t"), "the columns must be"),
    "nothing": ("", "not an empty line"),
    "NUL bytes": (b"\0" * 4096, "the columns must be"),
    "no size": (f"{COLUMNS}\n0,goal,nan,0,8,8\n", "x_min must be a number"),
    "endless": (f"{COLUMNS}\n0,goal,0,0,inf,8\n", "x_max must be a number"),
    "turned over": (f"{COLUMNS}\n0,goal,8,0,0,8\n", "x_min < x_max"),
    "beyond float32": (f"{COLUMNS}\n0,goal,-1e300,0,1e300,8\n", "x_min must be a number"),
    "below float32": (f"{COLUMNS}\n0,goal,0,0,1e-300,8\n", "above 0"),
    "twice": (f"{COLUMNS}\n{ROW}\n{ROW}\n", "a second 'goal' in frame 0"),
    "no class": ("frame,x_min,y_min,x_max,y_max\n0,0,0,8,8\n", "the columns must be"),
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
    argv = [
        "demos",
        "import-videos",
        "films",
        "--half-extent",
        "1",
        "--boxes",
        "True",
        "--out",
        "new",
    ]
    refused(home, argv, words, capsys)


@pytest.mark.parametrize("to", ["/dev/zero", "pipe", "a.csv", "gone.csv"])
def test_boxes_that_are_no_file_are_refused(home, capsys, to):
    folder = films(home)
    film(folder / "a.mp4")
    if to == "pipe":
        os.mkfifo(folder / "pipe")
    (folder / "a.csv").symlink_to(to)
    argv = [
        "demos",
        "import-videos",
        "films",
        "--half-extent",
        "1",
        "--boxes",
        "True",
        "--out",
        "new",
    ]
    refused(home, argv, "a.csv: the boxes file cannot be read", capsys)


@pytest.mark.parametrize("given", [BOXES.replace("\n", "\r\n"), "\ufeff" + BOXES])
def test_boxes_with_other_line_ends_and_marks_are_read(home, capsys, given):
    film(films(home) / "a.mp4")
    (home / "films" / "a.csv").write_bytes(given.encode())
    argv = [
        "demos",
        "import-videos",
        "films",
        "--half-extent",
        "1",
        "--boxes",
        "True",
        "--out",
        "new",
    ]
    assert command(argv, capsys)[0] == 0


# --- pickles


def packed(data):
    return lambda file: file.write_bytes(gzip.compress(data))


PICKLES = {
    "code": (packed(pickle.dumps(Writes("ran"))), "could run foreign code"),
    "code below data": (packed(pickle.dumps({"a": [1, Writes("ran")]})), "could run foreign code"),
    "builtins": (packed(b"cbuiltins\neval\n(S'1'\ntR."), "builtins.eval"),
    "nothing": (packed(b""), "not a whole pickle"),
    "a long number": (packed(b"I" + b"9" * 10_000 + b"\n."), "not a whole pickle"),
    "a huge place": (packed(b"r\xff\xff\xff\x7f."), "not a whole pickle"),
    "no archive": (lambda file: file.write_text("hello"), "not a whole gzip file"),
    "a pipe": (os.mkfifo, "cannot be read"),
    "a device": (lambda file: file.symlink_to("/dev/zero"), "cannot be read"),
    "a folder": (lambda file: file.mkdir(), "cannot be read"),
}


@pytest.mark.parametrize("kind", PICKLES)
def test_foreign_pickles_are_refused(home, capsys, kind):
    make, words = PICKLES[kind]
    make(films(home) / "a.pkl.gz")
    refused(home, ["demos", "import-magical", "films", "--out", "new"], words, capsys)


# --- the output


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
    "the folder of the films": (lambda home: ["--out", "films"], "holds other files"),
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
    source = ["demos", "import-videos", "films", "--half-extent", "1", "--boxes", "True"]
    refused(home, source + make(home), words, capsys)


def test_a_set_is_not_replaced_by_what_is_read_from_it(home, capsys):
    argv = ["demos", "import-videos", "set", "--half-extent", "1", "--out", "./set"]
    refused(home, argv, "is read", capsys)


def test_a_link_to_a_set_keeps_its_place(home, capsys):
    film(films(home) / "a.mp4")
    (home / "films" / "a.csv").write_text(BOXES)
    (home / "link").symlink_to("set")
    source = ["demos", "import-videos", "films", "--half-extent", "1", "--boxes", "True"]
    assert command([*source, "--out", "link"], capsys)[0] == 0
    assert (home / "link").is_symlink()
    assert sorted(os.listdir(home)) == ["films", "letter.txt", "link", "run", "set"]
    assert sorted(os.listdir(home / "set")) == ["000.mp4", "000.npz", "demos.json"]


@pytest.mark.parametrize(
    "verb", ["eval", "report", "export-reward", "audit", "demos import-videos"]
)
def test_an_input_of_an_impossible_name_is_refused(home, capsys, verb):
    more = {"export-reward": ["--out", "r.npz"]}
    more["demos import-videos"] = ["--out", "new", "--half-extent", "1"]
    refused(home, [*verb.split(), "n" * 5000, *more.get(verb, [])], "too long", capsys)


# --- demonstration sets


def in_header(**fields):
    def change(folder):
        header = json.loads((folder / "demos.json").read_text())
        (folder / "demos.json").write_text(json.dumps(header | fields))

    return change


def in_entry(**fields):
    def change(folder):
        header = json.loads((folder / "demos.json").read_text())
        header["demos"][0] |= fields
        (folder / "demos.json").write_text(json.dumps(header))

    return change


def with_tracks(make):
    """Tracks of which the header has the right digest."""

    def change(folder):
        make(folder / "000.npz")
        digest = hashlib.sha256((folder / "000.npz").read_bytes()).hexdigest()
        in_entry(tracks_sha256=digest)(folder)

    return change


def as_link(name, to):
    def change(folder):
        (folder / name).unlink()
        (folder / name).symlink_to(to)

    return change


def pipe(name):
    def change(folder):
        (folder / name).unlink(missing_ok=True)
        os.mkfifo(folder / name)

    return change


FIELDS = ("center", "size", "label", "seen")


def tracks(contents, **how):
    return with_tracks(lambda file: archive(file, **how, **dict.fromkeys(FIELDS, contents)))


def pickled(file):
    np.savez(file, **dict.fromkeys(FIELDS, np.array([Writes("ran")], object)))


SETS = {
    "a path upwards": (in_entry(video="../../x.mp4"), "plain file name"),
    "a whole path": (in_entry(tracks="/etc/passwd"), "plain file name"),
    "two dots": (in_entry(video=".."), "'..'"),
    "a NUL": (in_entry(video="a\0.mp4"), "plain file name"),
    "a long name": (in_entry(video="n" * 5000), "plain file name"),
    "half a letter": (in_entry(name="\ud800"), "text"),
    "half a letter in a class": (in_header(classes=["\udfff"]), "text"),
    "a number beyond all": (in_header(half_extent=10**400), "half_extent must be"),
    "frames beyond all": (in_header(fps=10**400), "fps must be"),
    "no number": (in_header(fps=float("nan")), "fps must be above 0"),
    "many frames": (in_entry(frames=10**300), "000.npz: center is"),
    "deep": (lambda f: (f / "demos.json").write_text(DEEP), "not a JSON file"),
    "digits": (lambda f: (f / "demos.json").write_text("9" * 5000), "not a JSON file"),
    "no text": (lambda f: (f / "demos.json").write_bytes(b"\xff\xfe"), "not a JSON file"),
    "a link to a letter": (as_link("000.npz", "../../letter.txt"), "digest"),
    "a dangling link": (as_link("000.mp4", "gone"), "is missing"),
    "a link to itself": (as_link("000.mp4", "000.mp4"), "is missing"),
    "a pipe": (pipe("000.npz"), "is missing"),
    "pickled code": (with_tracks(pickled), "not an npz file of plain arrays"),
    "a huge shape": (tracks(npy(HUGE)), "000.npz: "),
    "a shape below 0": (tracks(npy((-1,))), "000.npz: "),
    "an unknown packing": (tracks(npy((2,), data=bytes(8)), method=zipfile.ZIP_LZMA), "000.npz: "),
    "an array's header that is code": (
        tracks(npy((1,)).replace(b"'shape'", b"exit(3)")),
        "000.npz: ",
    ),
    "no array": (tracks(b"hello"), "000.npz: "),
    "a lone array": (with_tracks(lambda f: f.write_bytes(npy((1,), data=bytes(4)))), "000.npz: "),
}  # fmt: skip


@pytest.mark.parametrize("kind", SETS)
def test_a_broken_demonstration_set_is_refused(home, capsys, kind):
    change, words = SETS[kind]
    os.system(f"rm -r {home / 'run' / 'demos'}; cp -r {home / 'set'} {home / 'run' / 'demos'}")
    change(home / "run" / "demos")
    refused(home, ["report", "run"], words, capsys)


@pytest.mark.slow
def test_a_set_that_unpacks_to_gigabytes_is_refused(home, capsys):
    with_tracks(lambda file: bomb(file, "center"))(home / "run" / "demos")
    refused(home, ["report", "run"], "unpacks to more than", capsys)


# --- runs


def profiles(make):
    return lambda run: make(run / "profiles.npz")


def written(name, data):
    return lambda run: (run / name).write_bytes(data)


RUNS = {
    "pickled code": (profiles(lambda f: np.savez(f, names=np.array([Writes("ran")]))), "plain"),
    "a bare pickle": (written("profiles.npz", pickle.dumps(Writes("ran"))), "plain arrays"),
    "a huge shape": (profiles(lambda f: archive(f, names=npy(HUGE, "<U9"))), "profiles.npz"),
    "huge letters": (profiles(lambda f: archive(f, names=npy((2,), "<U500000000"))), "profiles"),
    "no letters": (
        profiles(lambda f: np.savez(f, **_profiles(names=_letter(0x7FFFFFFF)))),
        "profiles.npz",
    ),
    "half a letter": (profiles(lambda f: np.savez(f, **_profiles(names=_letter(0xD800)))), "text"),
    "profiles that are a pipe": (pipe("profiles.npz"), "profiles.npz"),
    "a folder of profiles": (
        lambda run: ((run / "profiles.npz").unlink(), (run / "profiles.npz").mkdir()),
        "profiles.npz",
    ),
    "results that are a pipe": (pipe("results.json"), "results.json"),
    "results without end": (as_link("results.json", "/dev/zero"), "results.json"),
    "results that are deep": (written("results.json", DEEP.encode()), "results.json is not JSON"),
    "metrics that are a pipe": (pipe("metrics.jsonl"), "metrics.jsonl"),
    "metrics without end": (as_link("metrics.jsonl", "/dev/zero"), "metrics.jsonl"),
    "versions that are a pipe": (pipe("versions.json"), "versions.json"),
    "phases that are a pipe": (pipe("phases.json"), "phases.json"),
    "phases of a later version": (
        written("phases.json", b'{"version": 99, "config": ""}'),
        "phases.json",
    ),
    "a configuration that is code": (
        written("config.yaml", b"!!python/object/apply:os.system ['touch ran']"),
        "not YAML",
    ),
    "a configuration of a later version": (written("config.yaml", b"warp: {x: 1}"), "no section"),
    "a configuration without end": (as_link("config.yaml", "/dev/zero"), "no config.yaml"),
    "a link to itself": (as_link("config.yaml", "config.yaml"), "no config.yaml"),
}  # fmt: skip


def _letter(code):
    return np.array([code, code, code], "<u4").view("<U1")


def _profiles(**changes):
    ones = np.ones((3, 8), np.float32)
    split, length = np.array(["train", "validation", "failure"]), np.full(3, 8, np.int32)
    found = {"names": np.array(["one", "two", "three"]), "split": split, "length": length}
    return found | {"reward": ones, "transitions": ones > 2} | changes


@pytest.mark.parametrize("kind", RUNS)
def test_a_hostile_run_is_refused(home, capsys, kind):
    change, words = RUNS[kind]
    change(home / "run")
    refused(home, ["report", "run"], words, capsys)


@pytest.mark.slow
def test_profiles_that_unpack_to_gigabytes_are_refused(home, capsys):
    bomb(home / "run" / "profiles.npz", "names")
    refused(home, ["report", "run"], "unpacks to more than", capsys)


def test_names_that_are_formulas_markup_or_long_are_drawn_as_text(home, capsys):
    names = ("$\\frac{$", "<img src=x onerror=alert(1)>" * 40, "a\nb\x1b[31m\0")
    run = save_run(home / "odd", names=names, pretrain=1, ppo=0)
    for place in (".report.html.part", "report.html"):
        (run / place).symlink_to(home / "letter.txt")
    before = (home / "letter.txt").read_text()
    code, said = command(["report", "odd"], capsys)
    assert code == 0, said
    assert "<img src=x" not in (run / "report.html").read_text()
    assert (home / "letter.txt").read_text() == before


# --- configurations

BOMB = "\n".join(
    [
        "a0: &a0 {x: 1}",
        *(f"a{i}: &a{i} {{<<: [{', '.join([f'*a{i - 1}'] * 10)}]}}" for i in range(1, 9)),
    ]
)
LISTS = "\n".join(
    ["a0: &a0 [1]", *(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 9))]
)
YAML = {
    "a call": ("env: !!python/object/apply:os.system ['touch ran']", "not YAML"),
    "a new object": ("env: !!python/object/new:os.system ['touch ran']", "not YAML"),
    "a module": ("env: !!python/module:antigravity", "not YAML"),
    "a name": ("env: {name: !!python/name:os.system }", "not YAML"),
    "merged maps": (BOMB, "'<<'"),
    "lists of lists": (LISTS, "no section 'a0'"),
    "lists in a field": ("env: {targets: [[1]]}", "env"),
    "itself": ("&a [*a]", "sections"),
    "itself as a section": ("env: &a {name: *a}", "single value"),
    "an empty number": ("run: {seed: !!int ''}", "not YAML"),
    "no truth": ("run: {seed: !!bool maybe}", "not YAML"),
    "no date": ("run: {seed: !!timestamp never}", "not YAML"),
    "a number of many digits": (f"run: {{seed: 0x{'f' * 9000}}}", "run.seed"),
    "deep": (DEEP, "not YAML"),
    "an option in a list": ("env: {targets: ['--help']}", "env.targets"),
    "another option in a list": ("env: {targets: ['--run.out=/tmp/x']}", "env.targets"),
    "two documents": ("run: {seed: 1}\n---\nrun: {seed: 2}", "not YAML"),
    "NUL": ("run: {seed: \0}", "not YAML"),
    "a key that is a list": ("? [a, b]\n: 1", "not YAML"),
}  # fmt: skip


@pytest.mark.parametrize("kind", YAML)
def test_a_hostile_configuration_is_refused(home, capsys, kind):
    given, words = YAML[kind]
    (home / "c.yaml").write_text(given)
    refused(home, ["pretrain", "c.yaml", "--out", "new"], words, capsys)


# --- rewards


def reward_bytes(name):
    return lambda home: (home / "reward.npz").write_bytes(name)


REWARDS = {
    "a bare pickle": reward_bytes(pickle.dumps(Writes("ran"))),
    "pickled code": lambda home: np.savez(
        home / "reward.npz", goal=np.array([Writes("ran")]), description=np.array("{}")
    ),
    "a huge shape": lambda home: archive(
        home / "reward.npz", goal=npy(HUGE), description=npy((), "<U2", "{}".encode("utf-32-le"))
    ),
    "huge letters": lambda home: archive(home / "reward.npz", description=npy((), "<U500000000")),
    "a link to itself": lambda home: (home / "reward.npz").symlink_to("reward.npz"),
    "a link to a device": lambda home: (home / "reward.npz").symlink_to("/dev/zero"),
    "a pipe": lambda home: os.mkfifo(home / "reward.npz"),
    "another letter": lambda home: (home / "reward.npz").symlink_to("letter.txt"),
}


@pytest.mark.parametrize("kind", REWARDS)
def test_a_hostile_reward_is_refused(home, capsys, kind):
    REWARDS[kind](home)
    refused(home, ["audit", "reward.npz", "--out", "new"], "reward.npz", capsys)
