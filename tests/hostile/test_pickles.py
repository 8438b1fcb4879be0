"""MAGICAL's pickles could be code: nothing of them runs."""

import gzip
import os
import pickle

import pytest
from support.hostile_home import films, refused
from support.pickled_code import Writes


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
    refused(home, ["demos", "import-videos", "films", "--out", "new"], words, capsys)
