"""The chunk loop: rows, checkpoints, interruptions, damage; and what kill -9 leaves goes on."""

import functools
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.paths import TESTS
from support.run_folders import differing

from gril_jax.config import RunConfig
from gril_jax.errors import RunError
from gril_jax.runs import loop, run_dir
from gril_jax.runs.checkpoints import checkpoint
from gril_jax.runs.checkpoints.state_leaves import digest
from gril_jax.runs.interrupt import Interrupted


class Walk(NamedTuple):
    """A state with all that a training's has: weights, a key, a counter."""

    place: jax.Array
    key: jax.Array
    steps: jax.Array


def _fresh():
    return Walk(jnp.zeros(64), jax.random.key(0), jnp.zeros((), jnp.int32))


@functools.partial(jax.jit, donate_argnums=0)
def _advance(state):
    key, draw = jax.random.split(state.key)
    place = jnp.sin(3 * state.place) + jax.random.normal(draw, (64,))
    return Walk(place, key, state.steps + 1), {"mean": place.mean()}


def in_calls(step=_advance):
    """The function that the loop calls: each chunk is a single call."""

    def advance(state, chunk, made):
        state, metrics = step(state)
        return state, 1, jax.device_get(metrics)

    return advance


def _row(done, seconds, metrics):
    return {"step": done, "mean": metrics["mean"]}


def _train(path, chunks=12, advance=None, row=_row, every_s=0, **more):
    """The whole of a phase, in a new folder or in one that was left; (trained, sentences)."""
    told = []
    opened = run_dir.resume(path) if path.exists() else run_dir.create(
        path, RunConfig(), device="cpu", command=["walk"], experiment="train"
    )  # fmt: skip
    with opened as run:
        begun = loop.restore(run, "walk", _fresh(), tell=told.append)
        options = {"run": run, "name": "walk", "chunks": chunks, "every_s": every_s, "keep": 3}
        return loop.run_chunks(advance or in_calls(), begun, row=row, **(options | more)), told


def _rows(path):
    return run_dir.read_metrics(path)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A run that nothing disturbed, and the digest of its last state."""
    path = tmp_path_factory.mktemp("whole") / "run"
    return path, digest(_train(path)[0].state)


def test_a_loop_by_hand_comes_to_the_same(whole):
    path, wanted = whole
    state = _fresh()
    for done in range(1, 13):
        state, metrics = _advance(state)
        row = {"phase": "walk", "step": done, "mean": float(np.float32(metrics["mean"]))}
        assert _rows(path)[done - 1] == row
    assert digest(state) == wanted
    assert checkpoint.steps(path / "checkpoints" / "walk")[-1] == 12


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_saves_and_leaves_after_its_chunk_and_the_run_goes_on(whole, tmp_path, number):
    def row(done, seconds, metrics):
        if done == 5:
            signal.raise_signal(number)
        return _row(done, seconds, metrics)

    with pytest.raises(Interrupted, match="the run is saved after 5 of 12 chunks") as caught:
        _train(tmp_path / "run", row=row, every_s=1e9)
    assert caught.value.exit_code == 128 + number
    assert f"gril train --resume {tmp_path / 'run'}" in str(caught.value)
    assert checkpoint.steps(tmp_path / "run" / "checkpoints" / "walk") == [5]
    trained, told = _train(tmp_path / "run", every_s=1e9)
    assert (digest(trained.state), told) == (whole[1], [])
    assert _rows(tmp_path / "run") == _rows(whole[0])


def _in_parts(asked):
    """Chunks of three moves, of which a call makes one; before a call, `asked` sees where it is."""

    def advance(state, chunk, made):
        asked(chunk, made)
        if made < 2:  # the state waits for the last one, but says that it has come so far
            return state._replace(steps=state.steps + 1), made + 1, None
        state, metrics = _advance(state._replace(steps=state.steps - 2))
        return state, 3, jax.device_get(metrics)

    return advance


def test_signals_between_the_calls_of_a_chunk_change_no_bit(whole, tmp_path):
    draw, path = random.Random(0), tmp_path / "run"
    moments = sorted(draw.sample([(n, m) for n in range(12) for m in range(3)], 8))
    seen = []

    def asked(chunk, made):
        seen.append((chunk, made))
        if (chunk, made) in moments:
            moments.remove((chunk, made))
            signal.raise_signal(signal.SIGTERM)

    more = {"advance": _in_parts(asked), "start": lambda chunk: 3 * chunk, "every_s": 1e9}
    while moments:
        with pytest.raises(Interrupted, match="the run is saved after"):
            _train(path, **more)
    trained, told = _train(path, **more)
    assert (digest(trained.state), told, trained.chunks) == (whole[1], [], 12)
    assert _rows(path) == _rows(whole[0])
    assert seen == sorted(set(seen)), "a call that was saved is not made again"
    assert checkpoint.steps(path / "checkpoints" / "walk") == [36]


def test_rows_after_the_checkpoint_are_cut_and_seconds_go_on(whole, tmp_path):
    path = tmp_path / "run"
    shutil.copytree(whole[0], path)
    for step in (10, 11, 12):
        shutil.rmtree(path / "checkpoints" / "walk" / f"{step:012d}", ignore_errors=True)
    _save(path, 3)
    trained, _ = _train(path)
    assert digest(trained.state) == whole[1]
    assert _rows(path) == _rows(whole[0])
    seconds = [row["seconds"] for row in run_dir.read_metrics(path, clocks=True)]
    assert seconds == sorted(seconds)
    assert trained.seconds == seconds[-1]


def _save(path, chunks):
    """Saves a checkpoint as the run did after so many chunks; returns its folder."""
    data = b"".join((path / "metrics.jsonl").read_bytes().splitlines(keepends=True)[:chunks])
    mark = {"lines": chunks, "bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
    state = _state_after(chunks)
    return checkpoint.save(path / "checkpoints" / "walk", chunks, state, metrics=mark)


def _state_after(chunks):
    state = _fresh()
    for _ in range(chunks):
        state, _ = _advance(state)
    return state


def test_a_phase_that_is_done_is_not_repeated(whole, tmp_path):
    path = tmp_path / "run"
    shutil.copytree(whole[0], path)
    with run_dir.resume(path) as run:
        run.log(phase="what came after", seconds=1e6)
        run.finish_phase("what came after", {})
    trained, _ = _train(path, advance=pytest.fail)
    assert digest(trained.state) == whole[1]
    assert trained.seconds < 1e6
    assert run_dir.read_metrics(path)[-1]["phase"] == "what came after"


def test_a_folder_that_is_renamed_meanwhile_ends_the_run_and_no_second_one_appears(whole, tmp_path):
    path, moved = tmp_path / "run", tmp_path / "moved"

    def row(done, seconds, metrics):
        if done == 5:
            path.rename(moved)
        return _row(done, seconds, metrics)

    with pytest.raises(RunError, match="renamed or deleted while the run wrote to it"):
        _train(path, row=row, every_s=1e9)  # no checkpoint is being written at that time
    assert not path.exists()
    assert digest(_train(moved)[0].state) == whole[1]
    assert _rows(moved) == _rows(whole[0])


def test_a_damaged_checkpoint_is_told_and_set_aside_and_the_one_before_taken(whole, tmp_path):
    path = tmp_path / "run"
    with pytest.raises(ZeroDivisionError):
        _train(path, row=_fails_after(8), every_s=1e9)
    for step in (3, 6):
        newest = _save(path, step)
    file = next(p for p in (newest / "arrays" / "00000").iterdir() if not p.name.startswith("."))
    file.write_bytes(file.read_bytes()[:-1])
    trained, (sentence,) = _train(path)
    assert f"{newest} is damaged: leaf place has changed: it is set aside as " in sentence
    assert newest.with_name(f"{newest.name}.damaged").is_dir()
    assert digest(trained.state) == whole[1]
    assert _rows(path) == _rows(whole[0])


def test_a_damaged_manifest_is_told_and_the_rows_of_the_checkpoint_before_it_stay(whole, tmp_path):
    path = tmp_path / "run"
    for chunks in (4, 8):
        with pytest.raises(ZeroDivisionError):
            _train(path, row=_fails_after(chunks))
    *_, before, newest = sorted((path / "checkpoints" / "walk").glob("*"))
    (newest / "manifest.json").write_text("{}")
    with pytest.raises(RunError, match=f"{newest} is damaged"):
        run_dir.read_metrics(path)
    trained, (sentence,) = _train(path)
    assert f"{newest} is damaged: its manifest cannot be read: it is set aside" in sentence
    assert digest(trained.state) == whole[1]
    assert _rows(path) == _rows(whole[0])
    assert before.name < newest.name


def test_with_all_checkpoints_damaged_a_phase_begins_again_and_says_so(whole, tmp_path):
    path = tmp_path / "run"
    with pytest.raises(ZeroDivisionError):
        _train(path, row=_fails_after(6))
    manifests = list((path / "checkpoints" / "walk").glob("*/manifest.json"))
    for file in manifests:
        file.write_text("{}")
    trained, told = _train(path)
    assert len(told) == len(manifests) > 0
    assert digest(trained.state) == whole[1]
    assert _rows(path) == _rows(whole[0])


def _fails_after(chunks):
    def row(done, seconds, metrics):
        if done > chunks:
            raise ZeroDivisionError
        return _row(done, seconds, metrics)

    return row


def test_a_checkpoint_of_another_structure_is_an_error_and_stays(tmp_path):
    run = run_dir.create(tmp_path / "run", RunConfig(), device="cpu")
    path = checkpoint.save(run.checkpoints / "walk", 1, {"other": jnp.zeros(1)})
    with run, pytest.raises(RunError, match="lacks the leaf place"):
        loop.restore(run, "walk", _fresh(), tell=pytest.fail)
    assert path.is_dir()


def test_rows_that_are_lost_are_an_error(whole, tmp_path):
    path = tmp_path / "run"
    shutil.copytree(whole[0], path)
    (path / "metrics.jsonl").write_text("")
    with pytest.raises(RunError, match="holds 0 whole lines, but the run had written 12"):
        _train(path)


def test_weak_types_of_a_fresh_state_are_gone_as_those_of_a_restored_one_are(tmp_path):
    run = run_dir.create(tmp_path / "run", RunConfig(), device="cpu")
    with run:
        begun = loop.restore(run, "walk", jnp.asarray(1.0), tell=pytest.fail)
    assert jnp.asarray(1.0).weak_type
    assert not begun.state.weak_type


def test_a_full_disk_ends_the_run_in_one_sentence_and_the_last_checkpoint_stays(
    tmp_path, monkeypatch
):
    real = checkpoint._write_arrays

    def full_at_three(path, arrays):
        if path.parent.name == f".{3:012d}.part":
            raise OSError(28, "No space left on device")
        real(path, arrays)

    monkeypatch.setattr(checkpoint, "_write_arrays", full_at_three)
    with pytest.raises(RunError, match="no space left"):
        _train(tmp_path / "run", chunks=3)
    state = checkpoint.restore(checkpoint.latest(tmp_path / "run/checkpoints/walk"), _fresh())
    assert int(state.steps) < 3


# --- kill -9

# Goes on with the run in a folder, or begins it, and kills itself some time after the first
# checkpoint from a given chunk on is complete.
_CHILD = """
import os, pathlib, signal, sys, threading, time
from runs import test_loop as t
path, chunk, delay_s = pathlib.Path(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
begun = []
def row(done, seconds, metrics):
    if chunk and not begun and t.checkpoint.steps(path / "checkpoints" / "walk")[-1:] >= [chunk]:
        begun.append(done)
        threading.Timer(delay_s, os.kill, (os.getpid(), signal.SIGKILL)).start()
    if chunk and not begun and done >= chunk:
        time.sleep(0.02)  # chunks must not outrun a slow disk: the checkpoint is being written
    if begun and done == t.MANY:
        signal.pause()  # not done before the timer, however slow the machine
    return t._row(done, seconds, metrics)
print(t.digest(t._train(path, row=row, chunks=t.MANY)[0].state))
"""
MANY = 1500


def _child(path, chunk, delay_s):
    environment = os.environ | {"JAX_PLATFORMS": "cpu", "PYTHONPATH": str(TESTS)}
    command = [sys.executable, "-c", _CHILD, str(path), str(chunk), str(delay_s)]
    return subprocess.run(command, capture_output=True, text=True, env=environment)


def test_kill_9_at_random_moments_changes_no_bit(tmp_path):
    path, draw = tmp_path / "run", random.Random(1)
    for chunk in (1, 500):
        done = _child(path, chunk, draw.uniform(0, 0.05))
        assert done.returncode == -signal.SIGKILL, done.stderr
        step = checkpoint.steps(path / "checkpoints" / "walk")[-1]
        assert len(run_dir.read_metrics(path)) >= step  # rows reach the disk first
    done = _child(path, 0, 0.0)
    assert done.returncode == 0, done.stderr
    whole, _ = _train(tmp_path / "whole", chunks=MANY, every_s=1e9)
    assert done.stdout.split() == [digest(whole.state)]
    assert differing(path, tmp_path / "whole") == []


@pytest.mark.slow
def test_none_of_200_planted_faults_is_restored_silently(tmp_path):
    good, draw, like = tmp_path / "good", random.Random(0), _fresh()
    saved = checkpoint.save(good, 7, _state_after(7))
    wanted, kinds = digest(_state_after(7)), {"flip": 0, "cut": 0, "missing": 0}
    for trial in range(200):
        folder = tmp_path / str(trial)
        shutil.copytree(good, folder)
        files = sorted(p for p in (folder / saved.name).rglob("*") if p.is_file())
        file, kind = draw.choice(files), draw.choice([*kinds])
        data = bytearray(file.read_bytes())
        if kind == "flip":
            data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
        file.write_bytes(data if kind == "flip" else data[: draw.randrange(len(data))])
        if kind == "missing":
            file.unlink()
        with pytest.raises(RunError):
            checkpoint.restore(folder / saved.name, like)
        kinds[kind] += 1
    assert digest(checkpoint.restore(saved, like)) == wanted
    print(json.dumps(kinds))
