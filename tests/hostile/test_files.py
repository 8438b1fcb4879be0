"""Configurations, MAGICAL's pickles and reward files that would run code, fill the memory or never
end."""

import gzip
import os
import pickle

import numpy as np
import pytest
from support.hostile import DEEP, HUGE, Writes, archive, films, npy, refused

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


REWARDS = {
    "a bare pickle": lambda file: file.write_bytes(pickle.dumps(Writes("ran"))),
    "pickled code": lambda file: np.savez(
        file, goal=np.array([Writes("ran")]), description=np.array("{}")
    ),
    "a huge shape": lambda file: archive(
        file, goal=npy(HUGE), description=npy((), "<U2", "{}".encode("utf-32-le"))
    ),
    "huge letters": lambda file: archive(file, description=npy((), "<U500000000")),
    "a link to itself": lambda file: file.symlink_to("reward.npz"),
    "a link to a device": lambda file: file.symlink_to("/dev/zero"),
    "a pipe": lambda file: os.mkfifo(file),
    "another letter": lambda file: file.symlink_to("letter.txt"),
}


@pytest.mark.parametrize("kind", REWARDS)
def test_a_hostile_reward_is_refused(home, capsys, kind):
    REWARDS[kind](home / "reward.npz")
    refused(home, ["audit", "reward.npz", "--out", "new"], "reward.npz", capsys)
