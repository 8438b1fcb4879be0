"""Runs that were tampered with."""

import pickle

import numpy as np
import pytest
from support.hostile_films import archive, bomb, npy
from support.hostile_home import DEEP, HUGE, as_link, command, pipe, refused
from support.pickled_code import Writes
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
    names = ("$\\frac{$", "<img src=x onerror=alert(1)>" * 40, "a\nb\x1b[31m\0")
    run = save_run(home / "odd", names=names, pretrain=1, ppo=0)
    for place in (".report.html.part", "report.html"):
        (run / place).symlink_to(home / "letter.txt")
    before = (home / "letter.txt").read_text()
    code, said = command(["report", "odd"], capsys)
    assert code == 0, said
    assert "<img src=x" not in (run / "report.html").read_text()
    assert (home / "letter.txt").read_text() == before
