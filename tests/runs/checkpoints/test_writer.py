"""Checkpoints in a thread: one at a time, from a copy, and no error is lost."""

import threading

import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.errors import RunError
from gril_jax.runs.checkpoints import checkpoint
from gril_jax.runs.checkpoints import writer as checkpoint_writer
from gril_jax.runs.checkpoints.writer import CheckpointWriter


@pytest.fixture
def gate(monkeypatch):
    """Holds the thread up until it is opened; the steps that were written follow."""
    event, written = threading.Event(), []

    def write(folder, step, leaves, keep, metrics):
        assert event.wait(30)
        written.append((step, float(leaves[0].array)))

    monkeypatch.setattr(checkpoint_writer.checkpoint, "write", write)
    return event, written


def test_a_state_is_written_as_it_was_when_it_was_saved(tmp_path):
    with CheckpointWriter(tmp_path, keep=2) as writer:
        for step in range(4):
            writer.save(step, {"x": jnp.full(3, step)})
        assert writer.longest_stall_s > 0
    assert checkpoint.steps(tmp_path) == [2, 3]
    state = checkpoint.restore(checkpoint.latest(tmp_path), {"x": jnp.zeros(3, jnp.int32)})
    np.testing.assert_array_equal(state["x"], 3)


def test_saving_does_not_wait_for_the_disk_and_leaving_does(gate, tmp_path):
    event, written = gate
    with CheckpointWriter(tmp_path, keep=2) as writer:
        assert not writer.busy
        writer.save(1, jnp.float32(0.5))
        assert writer.busy
        assert written == []
        event.set()
        writer.wait()
        assert not writer.busy
        writer.save(2, jnp.float32(1.5))
    assert written == [(1, 0.5), (2, 1.5)]


def test_what_it_counts_on_is_brought_to_the_disk_first(gate, tmp_path):
    event, written = gate
    event.set()
    with CheckpointWriter(tmp_path, keep=2, before=lambda: written.append("rows")) as writer:
        writer.save(1, jnp.float32(0.5))
    assert written == ["rows", (1, 0.5)]


def test_an_error_of_the_thread_comes_up_at_the_next_call(tmp_path):
    (tmp_path / "file").touch()

    def failed():
        writer = CheckpointWriter(tmp_path / "file", keep=1)
        writer.save(1, jnp.zeros(1))
        return writer

    with pytest.raises(RunError, match="cannot be written to"):
        failed().save(2, jnp.zeros(1))
    with pytest.raises(RunError, match="cannot be written to"):
        failed().wait()
    with pytest.raises(RunError, match="cannot be written to"), failed():
        pass
    with pytest.raises(ZeroDivisionError), failed():  # what went wrong first is what counts
        raise ZeroDivisionError
