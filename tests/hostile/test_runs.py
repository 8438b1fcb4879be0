"""Runs and demonstration sets that were tampered with."""

import hashlib
import json
import os
import pickle
import zipfile

import numpy as np
import pytest
from support.hostile import (
    DEEP,
    HUGE,
    Writes,
    archive,
    as_link,
    bomb,
    command,
    npy,
    pipe,
    refused,
)
from support.run_folders import save_run


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
    names = ("$\\frac{$", "<img src=x onerror=alert(1)>" * 40, "=1+1")
    run = save_run(home / "odd", names=names, pretrain=1, ppo=0)
    for place in (".report.html.part", "report.html"):
        (run / place).symlink_to(home / "letter.txt")
    before = (home / "letter.txt").read_text()
    code, said = command(["report", "odd"], capsys)
    assert code == 0, said
    assert "<img src=x" not in (run / "report.html").read_text()
    assert (home / "letter.txt").read_text() == before


# --- sets


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
    "a NUL": (in_entry(video="a\0.mp4"), "video must be text in printable letters"),
    "a line end in a name": (in_entry(name="a\nb"), "name must be text in printable letters"),
    "escapes in a class": (in_header(classes=["\x1b[31ma"]), "classes must be text in printable"),
    "escapes in a unit": (in_header(unit="\x1b]0;m\x07"), "unit must be text in printable letters"),
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
