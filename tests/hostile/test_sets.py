"""Demonstration sets that were tampered with."""

import hashlib
import json
import os
import zipfile

import numpy as np
import pytest
from support.hostile_films import archive, bomb, npy
from support.hostile_home import DEEP, HUGE, as_link, pipe, refused
from support.pickled_code import Writes


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
