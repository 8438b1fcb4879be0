"""Videos that no camera writes: refused in a sentence, or read right."""

import json
import os

import pytest
from support.hostile import (
    BOXES,
    COLOUR,
    IMPORT,
    SET,
    changing,
    command,
    contents,
    film,
    films,
    refused,
    sound,
    turned,
)

from gril_jax.demos.vision import video
from gril_jax.errors import printable

ONE = (16, 16)


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
    "one frame": (lambda f: film(f / "a.mp4", (ONE,)), "needs at least 2"),
    "another size on its way": (lambda f: changing(f / "a.mp4"), "a.mp4: "),
    "cut in the middle": (cut, "a.mp4: not a whole video"),
    "no pictures": (lambda f: sound(f / "a.mp4"), "holds no video stream"),
    "HTML": (text("<html><script>alert(1)</script>"), "not a whole video"),
    "a playlist of other files": (playlist, "not a whole video"),
    "a list of other videos": (list_of_films, "a.mp4: not a whole video"),
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
    refused(home, [*IMPORT, "--out", "new"], words, capsys)
    if kind not in ("one frame", "a damaged header"):  # their grey video shows no colour
        refused(home, COLOUR, words, capsys)


def test_a_film_that_would_fill_the_memory_is_refused(home, capsys, monkeypatch):
    film(films(home) / "a.mp4", (ONE,) * 100)
    monkeypatch.setattr(video, "_memory", lambda: 100_000)
    refused(home, COLOUR, "more than half of this machine's memory", capsys)


NAMES = {
    "spaces": "my first video",
    "a newline": "one\ntwo",
    "what a terminal obeys": "\x1b[31mred",
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
    argv = [*IMPORT[:2], ".", *IMPORT[3:], "--out", "../new"]
    code, said = command(argv, capsys)
    assert code == 0, said
    after = {k: v for k, v in contents(home).items() if k.split(b"/")[0] != b"new"}
    assert after == before
    header = json.loads((home / "new" / "demos.json").read_text())
    assert [entry["name"] for entry in header["demos"]] == [printable(NAMES[kind])]
    assert sorted(os.listdir(home / "new")) == [*SET, "import.png", "import.txt"]


@pytest.mark.slow
def test_ten_thousand_tiny_frames_are_read(home, capsys):
    film(films(home) / "a.mp4", (ONE,) * 10_000)
    (home / "films" / "a.csv").write_text(BOXES)
    argv = [*IMPORT, "--out", "new"]
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
    refused(home, COLOUR, "is not text in UTF-8", capsys)
