"""Reward files that would run code or never end."""

import os
import pickle

import numpy as np
import pytest
from support.hostile_films import archive, npy
from support.hostile_home import HUGE, refused
from support.pickled_code import Writes


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
