"""A run without a folder trains to the same bits as one with a folder, and writes nothing."""

import signal

import jax.numpy as jnp
import numpy as np
import pytest
from runs.test_loop import _fresh, _row, in_calls

from gril_jax.config import RunConfig
from gril_jax.runs import loop, memory, run_dir
from gril_jax.runs.checkpoints.state_leaves import digest
from gril_jax.runs.interrupt import Interrupted


def _all_of(run):
    """All that training does with a run; what came of it."""
    with run:
        fresh = _fresh()
        begun = loop.restore(run, "walk", fresh, tell=pytest.fail)
        done = loop.run_chunks(
            in_calls(), begun, run=run, name="walk", chunks=5, row=_row, every_s=0, keep=2
        )
        run.log(phase="later", odd=float("nan"), each=jnp.arange(2))
        run.note_time(stage="walk", seconds=1.5)
        assert run.finished_phase("walk") is None
        files = run.save_part("walked", 5, done.state) + run.save_arrays("a.npz", x=np.ones(2))
        run.cover("walk", files)
        run.finish_phase("walk", {"tau": 0.5}, files)
        run.finish({"tau": 0.5})
        rows = [{k: x for k, x in row.items() if k != "seconds"} for row in run.metrics()]
        loaded = run.load_part("walked", _fresh())
        return digest(done.state), digest(loaded), rows, run.finished_phase("walk")


def test_it_comes_to_the_same_as_a_run_with_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = _all_of(own := memory.MemoryRun())
    assert list(tmp_path.iterdir()) == []
    assert own.path is None
    assert own.results == {"tau": 0.5}
    assert own.times == [{"stage": "walk", "seconds": 1.5}]
    np.testing.assert_array_equal(own.arrays["a.npz"]["x"], 1)
    assert all(row["seconds"] > 0 for row in own.metrics()[:-1])
    kept = run_dir.create(tmp_path / "run", RunConfig(), device="cpu", experiment="train")
    assert found == _all_of(kept)
    assert run_dir.read_results(tmp_path / "run") == own.results


def test_both_offer_the_same_methods():
    offered = {name for name in vars(memory.MemoryRun) if not name.startswith("_")}
    assert offered - {"path"} <= set(vars(run_dir.RunDir))


def test_a_signal_ends_it_with_a_sentence_and_a_phase_that_begins_again_has_no_older_rows():
    def row(done, seconds, metrics):
        if done == 2:
            signal.raise_signal(signal.SIGTERM)
        return _row(done, seconds, metrics)

    with memory.MemoryRun() as run:
        run.log(phase="before")
        begun = loop.restore(run, "walk", _fresh(), tell=pytest.fail)
        options = {"run": run, "name": "walk", "chunks": 5, "row": row, "every_s": 0, "keep": 2}
        with pytest.raises(Interrupted, match="without a folder nothing of it is kept"):
            loop.run_chunks(in_calls(), begun, **options)
        assert [one["phase"] for one in run.metrics()] == ["before", "walk", "walk"]
        assert loop.restore(run, "walk", _fresh(), tell=pytest.fail).moves == 0
        assert [one["phase"] for one in run.metrics()] == ["before"]
