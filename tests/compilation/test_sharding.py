"""The sharing of devices, and training on eight of them, which comes to what one comes to."""

import json
import os
import subprocess
import sys

import jax
import numpy as np
import pytest
from jax.sharding import Mesh
from support.paths import TESTS
from support.sharded_training import REPLAY_BYTES

from gril_jax.compilation import sharding
from gril_jax.errors import ConfigError


@pytest.mark.parametrize(
    ("devices", "seeds", "num_envs", "shape"),
    [
        (1, 5, 7, (1, 1)),  # one device takes anything
        (8, 8, 1, (8, 1)),  # seeds first
        (8, 16, 1, (8, 1)),
        (8, 2, 64, (2, 4)),  # then environments
        (8, 12, 64, (4, 2)),
        (8, 1, 64, (1, 8)),
        (6, 4, 9, (2, 3)),
        (8, 5, 64, (1, 8)),  # no common divisor: all of them share the environments
    ],
)
def test_as_many_devices_as_possible_go_to_the_seeds(monkeypatch, devices, seeds, num_envs, shape):
    def grid(shape, names, *, devices, axis_types):
        return Mesh(np.array(devices).reshape(shape), names, axis_types=axis_types)

    monkeypatch.setattr(jax, "make_mesh", grid)
    found = sharding.mesh(range(devices), seeds=seeds, num_envs=num_envs)
    assert (found.axis_names, found.devices.shape) == (("seeds", "envs"), shape)


@pytest.mark.parametrize(
    ("devices", "seeds", "num_envs", "sentence"),
    [
        (8, 5, 60, "the seeds must be a multiple of 8, or num_envs of 8"),
        (8, 2, 30, "8 devices cannot share 2 seeds of 30 environments evenly"),
    ],
)
def test_devices_that_cannot_be_shared_out_are_refused(devices, seeds, num_envs, sentence):
    with pytest.raises(ConfigError, match=sentence):
        sharding.mesh(range(devices), seeds=seeds, num_envs=num_envs)


# Trains on one and on eight devices, and prints how far apart they come out.
_CHILD = """
import json, sys
import jax
from support import sharded_training as t
from gril_jax.rl import blocks
blocks._LEAST = 2  # so that few environments are blocks enough for all devices
devices = jax.devices()
assert len(devices) == 8
found = {}
for case in sys.argv[1:]:
    name, count = case.split(":")
    train = t.pretrained if name == "encoder" else lambda d, n: t.train(name, d, n)
    one, many = train(devices[:1], int(count)), train(devices, int(count))
    used = {len(x.sharding.device_set) for x in jax.tree.leaves(many)}
    found[case] = {"apart": t.apart(one, many), "used": sorted(used)}
    if name == "sac":
        found[case]["copied"] = t.temporary_bytes(name, devices, int(count))
    if name == "ppo":
        found[case]["exchanged"] = t.exchanged(name, devices, int(count))
print(json.dumps(found))
"""


def _eight_devices(*cases):
    flags = os.environ["XLA_FLAGS"].replace("level=1", "level=0")  # compiling is what takes time
    flags += " --xla_force_host_platform_device_count=8"
    environment = os.environ | {"XLA_FLAGS": flags, "PYTHONPATH": str(TESTS)}
    done = subprocess.run(
        [sys.executable, "-c", _CHILD, *cases], capture_output=True, text=True, env=environment
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def _check(found):
    for case, result in found.items():
        assert result["used"] == [8], case
        assert result["apart"] < 5e-5, case
        assert result.get("copied", 0) < 0.5 * REPLAY_BYTES, f"{case}: a step copies the replay"
        assert result.get("exchanged", 0) <= 64, f"{case}: more than scores goes between devices"


def test_eight_devices_come_to_what_one_comes_to():
    """Two seeds on four devices each, in chunks with an evaluation; and eight encoders."""
    _check(_eight_devices("ppo:2", "encoder:8"))


@pytest.mark.slow
def test_eight_devices_come_to_what_one_comes_to_with_a_replay_and_with_other_numbers_of_seeds():
    _check(_eight_devices("sac:2", "sac:8", "ppo:8", "ppo:16", "ppo:1", "encoder:2"))
