"""The host's side of training: compiled chunks one after another, logged, saved, interruptible.

    begun = restore(run, "ppo", algorithm.init(key), tell=echo)
    trained = run_chunks(advance, begun, run=run, name="ppo", chunks=20, row=row)

The state is any pytree. A run that was cut off, at whatever moment, goes on from its newest
checkpoint bit for bit: what a chunk does depends on nothing but the state before it.
"""

import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax

from . import checkpoint
from .checkpoint_writer import CheckpointWriter
from .interrupt import Interrupted, Notice, noticed
from .run_dir import RunDir

__all__ = ["Begun", "Trained", "restore", "run_chunks"]


class Begun(NamedTuple):
    """Where a phase starts, or goes on."""

    state: Any
    chunks: int  # that have been done
    seconds: float  # that they took


class Trained(NamedTuple):
    """What a phase came to."""

    state: Any
    seconds: float  # of all chunks, those before an interruption included
    stall_s: float  # that the longest copy of a checkpoint held the training up


def restore(run: RunDir, name: str, state: Any, *, tell: Callable[[str], None]) -> Begun:
    """The newest undamaged checkpoint of a phase, or a fresh state where there is none.

    Later rows of metrics.jsonl are cut off. Damaged checkpoints are set aside.

    Args:
      run: the run's folder.
      name: the phase.
      state: its fresh state; a weakly typed leaf becomes a strongly typed one.
      tell: takes a sentence for each damaged checkpoint.

    Raises:
      RunError: a checkpoint is of another structure than the state, or rows have been lost.
    """
    folder, chunks = run.checkpoints / name, 0
    while (path := checkpoint.latest(folder)) is not None:
        try:
            state = checkpoint.restore(path, state)
            chunks = int(path.name)
            break
        except checkpoint.DamagedError as error:
            aside = checkpoint.discard(path)
            tell(f"{error}: it is set aside as {aside.name}, and the one before it is taken")
    rows = [row for row in run.cut_metrics(name, chunks) if row.get("phase") == name]
    seconds = float(rows[-1].get("seconds") or 0.0) if rows else 0.0
    return Begun(jax.tree.map(_strong, state), chunks, seconds)


def run_chunks(
    advance: Callable[[Any], tuple[Any, Any]],
    begun: Begun,
    *,
    run: RunDir,
    name: str,
    chunks: int,
    row: Callable[[int, float, Any], Mapping[str, Any]],
    every_s: int | float,
    keep: int,
) -> Trained:
    """Runs a phase to its end: a row of metrics for each chunk, a checkpoint now and then.

    Args:
      advance: one chunk, from a state to the next and its metrics; it may donate the state.
      begun: what `restore` returned.
      run: the run's folder.
      name: the phase; metrics have it as "phase", and checkpoints go to a folder of this name.
      chunks: how many there are in all.
      row: from the chunks done, the seconds they took and a chunk's metrics on the host to a line
        of metrics.jsonl.
      every_s: least time between two checkpoints, seconds; the last state is always saved.
      keep: how many of the newest checkpoints stay.

    Raises:
      Interrupted: SIGINT or SIGTERM came; the state is saved.
      RunError: the disk is full or not writable; the last good checkpoint stays.
    """
    state, done, before_s = begun
    folder = run.checkpoints / name
    writer = CheckpointWriter(folder, keep=keep, before=run.sync_metrics)
    begun_s = saved_s = time.monotonic()
    seconds = before_s
    with writer, noticed() as notice:
        while done < chunks:
            state, metrics = advance(state)
            metrics = jax.device_get(metrics)
            done, now = done + 1, time.monotonic()
            seconds = before_s + now - begun_s
            run.log(phase=name, seconds=seconds, **row(done, seconds, metrics))
            last = done == chunks or notice.number is not None
            # One that is still being written is not waited for: the next chunk will do.
            if last or (not writer.busy and now - saved_s >= every_s):
                writer.save(done, state)
                saved_s = now
            if notice.number is not None:
                writer.wait()
                raise _interrupted(notice, run, name, done, chunks)
    return Trained(state, seconds, writer.longest_stall_s)


def _interrupted(notice: Notice, run: RunDir, name: str, done: int, chunks: int) -> Interrupted:
    assert notice.number is not None
    return Interrupted(
        f"{notice.name} came, and the run is saved after {done} of {chunks} chunks of phase "
        f"{name!r}: gril {run.experiment} --resume {run.path} goes on with it",
        notice.number,
    )


def _strong(leaf: Any) -> Any:
    """A restored leaf is strongly typed: a fresh one must compile to the same program."""
    return leaf.astype(leaf.dtype) if getattr(leaf, "weak_type", False) else leaf
