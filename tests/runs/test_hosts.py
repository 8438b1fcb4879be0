"""Processes that compute together: how they find each other, agree, and come to what one does."""

import os
import socket
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.paths import TESTS
from support.sharded_training import train

from gril_jax.cli.main import main
from gril_jax.errors import ConfigError, RunError
from gril_jax.runs import hosts
from gril_jax.runs.checkpoints.state_leaves import host_copy
from gril_jax.runs.cluster import cluster_of

SEEDS = 2
THREE = {"COORDINATOR_ADDRESS": "job-0.job:1234", "NUM_PROCESSES": "4", "PROCESS_ID": "3"}
SLURM = {"SLURM_JOB_ID": "1", "SLURM_NTASKS": "8", "SLURM_PROCID": "0"}


def test_three_variables_describe_a_job_also_inside_of_slurm():
    job = cluster_of(THREE)
    assert job == cluster_of(THREE | SLURM)
    assert (job["coordinator_address"], job["num_processes"]) == ("job-0.job:1234", 4)
    assert (job["process_id"], job["cluster_detection_method"]) == (3, "deactivate")


def test_slurm_alone_is_left_to_jax():
    assert cluster_of(SLURM) == {}


@pytest.mark.parametrize(
    ("environment", "sentence"),
    [
        ({}, "--distributed finds no job: start it by srun, or set COORDINATOR_ADDRESS"),
        ({"SLURM_JOB_ID": "1"}, "finds no job"),  # in a batch script, without srun
        ({**THREE, "PROCESS_ID": ""}, "COORDINATOR_ADDRESS is set, but PROCESS_ID is not"),
        ({"PROCESS_ID": "0"}, "PROCESS_ID is set, but COORDINATOR_ADDRESS is not"),
        (THREE | {"PROCESS_ID": "4"}, "PROCESS_ID is 4, but must be less than NUM_PROCESSES"),
        (THREE | {"NUM_PROCESSES": "four"}, "NUM_PROCESSES is 'four', but must be a whole number"),
        (THREE | {"COORDINATOR_ADDRESS": "job-0"}, "is 'job-0', but must be HOST:PORT"),
    ],
)
def test_anything_else_is_refused_in_one_sentence(environment, sentence):
    with pytest.raises(ConfigError, match=sentence):
        cluster_of(environment)


def test_the_command_line_is_refused_before_anything_is_imported(monkeypatch, capsys):
    for name in (*THREE, *SLURM):
        monkeypatch.delenv(name, raising=False)
    assert main(["sweep", "quickstart", "--distributed"]) == 2
    assert "--distributed finds no job" in capsys.readouterr().err


def test_in_a_process_by_itself_nothing_happens():
    tree = {"a": jnp.arange(3), "key": jax.random.key(0), "n": 1}
    assert hosts.is_first()
    assert hosts.same_everywhere(tree) is tree
    assert hosts.gathered(tree) == tree
    assert hosts.placed_like(tree, tree) == tree
    assert hosts.largest([3, True]) == [3, 1]
    with hosts.scratch() as folder:
        assert folder is None


def test_processes_that_cannot_be_connected_are_an_error_in_one_sentence(monkeypatch):
    """As here, where JAX has been used already."""
    monkeypatch.setattr(jax.config, "update", lambda *_: None)
    one = {"COORDINATOR_ADDRESS": "localhost:1", "NUM_PROCESSES": "1", "PROCESS_ID": "0"}
    with pytest.raises(RunError, match="the processes of the job cannot be connected"):
        hosts.initialize(cluster_of(one), timeout_s=1)


# One of two processes with two devices each: agrees with the other, trains, is told to stop, goes
# on from the checkpoint. Only the first one's file is kept.
_CHILD = """
import os, signal, sys
from gril_jax.runs import hosts
from gril_jax.runs.cluster import cluster_of
hosts.initialize(cluster_of(os.environ))
import jax, numpy as np
import jax.numpy as jnp
from support import sharded_training as t
from gril_jax.runs import loop, run_dir
from gril_jax.config import RunConfig
from gril_jax.runs.interrupt import Interrupted
from gril_jax.runs.checkpoints.state_leaves import host_copy

me, out = jax.process_index(), sys.argv[1]
assert hosts.is_first() == (me == 0)
assert hosts.largest([me, -me]) == [1, 0]
tree = {"x": jnp.array([-0.0, jnp.nan, me]), "key": jax.random.key(me), "yes": me == 0}
same = hosts.same_everywhere(tree)
assert np.signbit(same["x"][0]) and np.isnan(same["x"][1]) and same["x"][2] == 0 and same["yes"]
assert (jax.random.key_data(same["key"]) == jax.random.key_data(jax.random.key(0))).all()

fresh, run, inputs = t.begin("sac", jax.devices(), SEEDS)
assert len(jax.devices()) == 4 and not fresh.state.key.is_fully_addressable

def chunks(folder, path, state):
    def row(done, seconds, found):
        assert me == 0
        return {"success": found[0].success[:, 0, 1]}
    def advance(state, chunk, made):
        if me == 1 and not os.path.exists(out + ".told"):  # the second one alone is told to stop
            open(out + ".told", "w").close()
            signal.raise_signal(signal.SIGTERM)
        state, found = run(state, *inputs)
        return state, 1, jax.device_get(found)
    begun = loop.restore(folder, "sac", state, tell=print)
    return begun.moves, loop.run_chunks(
        advance, begun, run=folder, name="sac", chunks=2, row=row, every_s=1e9, keep=3)

with hosts.scratch() as scratch:
    assert (scratch is None) == (me == 0)
    path = (scratch or hosts.Path(out)) / "run"
    with run_dir.create(path, RunConfig(), device="cpu", experiment="sweep") as folder:
        copy = jax.tree.map(lambda x: x.copy(), fresh)
        try:
            chunks(folder, path, copy)
        except Interrupted as stop:
            left = "the run is saved" if me == 0 else "the run ends"
            assert f"SIGTERM came, and {left} after 1 of 2" in str(stop), stop
        else:
            raise AssertionError("nobody noticed the signal")
        before, done = chunks(folder, path, fresh)
    assert before == 1
    assert len(list(path.glob("checkpoints/sac/*"))) == (1 if me == 0 else 0)
state = host_copy(hosts.gathered(done.state))
if me == 0:
    np.savez(out + "/state.npz", *[leaf.array for leaf in state])
assert run._cache_size() == 1
print("done", scratch is None or not scratch.exists())
"""


def _port():
    with socket.socket() as free:
        free.bind(("localhost", 0))
        return free.getsockname()[1]


@pytest.mark.slow  # two interpreters; test_sharding has the devices
def test_two_processes_stop_and_go_on_together_and_come_to_what_one_comes_to(tmp_path):
    flags = os.environ["XLA_FLAGS"].replace("level=1", "level=0")  # compiling is what takes time
    flags += " --xla_force_host_platform_device_count=2"
    environment = os.environ | {
        "XLA_FLAGS": flags, "PYTHONPATH": str(TESTS), "JAX_PLATFORMS": "cpu",
        "COORDINATOR_ADDRESS": f"localhost:{_port()}", "NUM_PROCESSES": "2",
    }  # fmt: skip
    source = _CHILD.replace("SEEDS", str(SEEDS))
    children = [
        subprocess.Popen(
            [sys.executable, "-c", source, str(tmp_path)],
            env=environment | {"PROCESS_ID": str(i)},
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )
        for i in range(2)
    ]  # fmt: skip
    wanted = host_copy(train("sac", jax.devices()[:1], SEEDS)[0])
    try:
        for child in reversed(children):  # a failure of one leaves the other waiting for it
            printed, errors = child.communicate(timeout=120)
            assert child.returncode == 0, errors
            assert printed.splitlines()[-1] == "done True"
    finally:
        for child in children:
            child.kill()
    with np.load(tmp_path / "state.npz") as file:
        found = [file[name] for name in file.files]
    for leaf, array in zip(wanted, found, strict=True):
        np.testing.assert_allclose(array, leaf.array, atol=5e-5, err_msg=leaf.path)
