"""Files that would run code, fill the memory or never end: configurations, pickles and rewards."""

import gzip
import os
import pickle

import numpy as np
import pytest
from support.hostile_films import archive, npy
from support.hostile_home import DEEP, HUGE, films, refused
from support.pickled_code import Writes

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
    "a name": ("env: {name: !!python/name:os.system }", "not YAML"),
    "merged maps": (BOMB, "'<<'"),
    "lists of lists": (LISTS, "no section 'a0'"),
    "lists in a field": ("env: {targets: [[1]]}", "env"),
    "itself": ("&a [*a]", "sections"),
    "itself as a section": ("env: &a {name: *a}", "single value"),
    "an empty number": ("run: {seed: !!int ''}", "not YAML"),
    "a number of many digits": (f"run: {{seed: 0x{'f' * 9000}}}", "run.seed"),
    "deep": (DEEP, "not YAML"),
    "an option in a list": ("env: {targets: ['--help']}", "env.targets"),
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
    "a long number": (packed(b"I" + b"9" * 10_000 + b"\n."), "not a whole pickle"),
    "a huge place": (packed(b"r\xff\xff\xff\x7f."), "not a whole pickle"),
    "a pipe": (os.mkfifo, "cannot be read"),
    "a device": (lambda file: file.symlink_to("/dev/zero"), "cannot be read"),
}


@pytest.mark.parametrize("kind", PICKLES)
def test_foreign_pickles_are_refused(home, capsys, kind):
    make, words = PICKLES[kind]
    make(films(home) / "a.pkl.gz")
    refused(home, ["demos", "import-videos", "films", "--out", "new"], words, capsys)


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
