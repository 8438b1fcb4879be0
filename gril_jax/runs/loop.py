"""The host's training loop: compiled chunks one after another, logged, saved, interruptible.

    begun = restore(run, "ppo", algorithm.init(key), tell=echo)
    trained = run_chunks(advance, begun, run=run, name="ppo", chunks=20, row=row)

The state is any pytree. A run that was cut off, at whatever time, goes on from its newest
checkpoint bit for bit: what a chunk does depends on nothing but the state before it. A chunk may
take several calls, between which the run saves and heeds signals, too. Where it stands is counted
in moves: `start(chunk)` of them come before a chunk. Of several processes (`gril_jax.runs.hosts`)
the first decides when to save, logs, and writes whole states.
"""

import signal
import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax

from . import hosts
from .interrupt import Interrupted, noticed
from .memory import Run


class Begun(NamedTuple):
    """The point at which a phase starts, or goes on."""

    state: Any
    moves: int  # that have been made
    seconds: float  # that they took


class Trained(NamedTuple):
    """The results of a phase."""

    state: Any
    chunks: int  # that have been done
    seconds: float  # that they took, those before an interruption included
    stall_s: float  # that the longest copy of a checkpoint held the training up


def restore(run: Run, name: str, state: Any, *, tell: Callable[[str], None]) -> Begun:
    """The newest undamaged checkpoint of a phase, or the fresh state, strongly typed, without one.

    Later rows of metrics.jsonl are cut off. Damaged checkpoints are set aside, and `tell` takes a
    sentence for each. What is restored goes to the devices on which the fresh state is. Another
    structure than that of the state, or lost rows, are a RunError.
    """
    found, moves, seconds = state, 0, 0.0
    if hosts.is_first():
        found, moves = run.newest(name, state, tell)
        rows = [row for row in run.metrics() if row.get("phase") == name]
        seconds = float(rows[-1].get("seconds") or 0.0) if rows else 0.0
    (moves,) = hosts.largest([moves])  # those of the first: others know of none
    if moves:
        state = hosts.placed_like(hosts.same_everywhere(found), state)
    return Begun(jax.tree.map(_strong, state), moves, seconds)


def run_chunks(
    advance: Callable[[Any, int, int], tuple[Any, int, Any]],
    begun: Begun,
    *,
    run: Run,
    name: str,
    chunks: int,
    row: Callable[[int, float, Any], Mapping[str, Any]],
    every_s: int | float,
    keep: int = 3,
    start: Callable[[int], int] = lambda chunk: chunk,
    is_over: Callable[[int, Any], bool] = lambda done, state: False,
) -> Trained:
    """Runs a phase to its end, with a row of metrics for each chunk and occasional checkpoints.

    Args:
      advance: one call, (state, chunk, made) -> (state, made, metrics); both count from 0. `made`
        are the moves of the chunk that the state contains. The metrics are None until the chunk is
        complete. The state may be donated.
      begun: what `restore` returned.
      name: the phase; metrics have it as "phase", and checkpoints go to a folder of this name.
      chunks: how many there are in all, or at most.
      row: makes a line of metrics.jsonl from the chunks done, the seconds they took and a chunk's
        metrics on the host; its clocks go to times.jsonl.
      every_s: seconds between two checkpoints. The last state is always saved.
      keep: how many of the newest checkpoints stay; at the end of the phase the last one alone.
      start: the moves before a chunk, which has one or more.
      is_over: from the chunks done and the state, whether the phase ends here; the same in all
        processes.

    Raises:
      Interrupted: SIGINT, SIGTERM or SIGHUP came; the state is saved.
      RunError: the disk is full or not writable; the last good checkpoint stays.
    """
    state, at, before_s = begun
    done = next(n for n in range(chunks, -1, -1) if start(n) <= at)
    made = at - start(done)
    begun_s = saved_s = time.monotonic()
    seconds = before_s
    with run.saving(name, keep=keep) as writer, noticed() as notice:
        over = done == chunks or (done > 0 and not made and is_over(done, state))
        while not over:
            state, made, metrics = advance(state, done, made)
            now = time.monotonic()
            seconds, due = before_s + now - begun_s, False
            if metrics is not None:
                done, made = done + 1, 0
                over = done == chunks or is_over(done, state)
            if hosts.is_first():
                if metrics is not None:
                    run.log(phase=name, seconds=seconds, **row(done, seconds, metrics))
                # One that is still being written is not waited for: the next call will do.
                due = writer is not None and not writer.busy and now - saved_s >= every_s
            due, number = hosts.largest([due, notice.number or 0])
            moves = start(done) + made
            if writer is not None and moves > at and (due or number or over):
                whole = hosts.gathered(state)
                if hosts.is_first():
                    writer.save(moves, whole)
                at, saved_s = moves, now
            if number:
                if writer is not None:
                    writer.wait()
                where = f"after {done} of {chunks} chunks of phase {name!r}"
                left = run.cut_off(where) if hosts.is_first() else f"the run ends {where}"
                raise Interrupted(f"{signal.Signals(number).name} came, and {left}", number)
    if hosts.is_first():
        run.settle(name)
    return Trained(state, done, seconds, 0.0 if writer is None else writer.longest_stall_s)


def _strong(leaf: Any) -> Any:
    """The leaf strongly typed like a restored one, so that both compile to the same program."""
    return leaf.astype(leaf.dtype) if getattr(leaf, "weak_type", False) else leaf
