"""Compiles programs while others run.

    with ahead.compiling() as pool:
        wanted = pool.submit(lambda: compiled(jax.jit(f).lower(x)))
        ...                                                  # something else
        y = wanted.result()(x)

    ahead.carry_out([Task("a", wanted, frozenset(), do), ...])   # first what is compiled first

XLA compiles outside of Python's lock, but tracing holds it: programs are traced one by one, within
`with ahead.tracing()`, so that the first need not wait until all are. With two cores each thing is
compiled when it is asked for; so it is with several processes, since arrays of all of them are
placed by all at once, in one order.
"""

import contextlib
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from typing import Any, NamedTuple

import jax

from gril_jax import threads
from gril_jax.runs.interrupt import Interrupted

_FEW = 4  # cores that one compiler and one training keep busy
_MOST = 8  # each compiler has threads of its own

_tracing = threading.RLock()


def tracing() -> contextlib.AbstractContextManager:
    """The lock held while a program is traced and lowered, but not while it is compiled."""
    return _tracing


@contextlib.contextmanager
def compiling() -> Iterator[Executor]:
    """A pool that compiles in order of submission, on half of the cores.

    What has not begun when the block ends, for whatever reason, is given up; what has is waited
    for, since a compiler cannot be stopped.
    """
    cores = threads.cores()
    spare = cores >= _FEW and jax.process_count() == 1
    pool = ThreadPoolExecutor(min(_MOST, cores // 2), "compile") if spare else _WhenAsked()
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


class Task(NamedTuple):
    """Work that may have to wait for a program or for other tasks."""

    name: str
    wanted: Future[Any] | None  # the program for it; None where it needs none
    needs: frozenset[str]  # names of the tasks that come before it
    do: Callable[[], None]
    about: Any = None  # for whom it is
    bears: bool = False  # goes on without some of what it needs


def carry_out(
    tasks: Iterable[Task], failed: Callable[[Task, Exception], None] | None = None
) -> None:
    """Runs each task once: always the first one whose needs are done and whose program is ready.

    Where programs are compiled when they are asked for, the order is that of the tasks as far as
    their needs allow, in every process. A need that never comes is a ValueError. With `failed` an
    error goes there, the tasks that need what it broke are left out, and the others go on. So do
    tasks that bear it while something is left of what they need.
    """
    left, done, lost = list(tasks), set[str](), set[str]()
    while left := [task for task in left if not _loses(task, lost)]:
        able = [task for task in left if task.needs <= (done | lost if task.bears else done)]
        if not able:
            name, needs = left[0].name, left[0].needs - done
            raise ValueError(f"task {name!r} needs what never comes: {needs}")
        # Of a `_Task` there is nothing to wait for: asking is what makes it.
        ready = (t for t in able if not t.wanted or isinstance(t.wanted, _Task) or t.wanted.done())
        task = next(ready, None)
        if task is None:
            wait([task.wanted for task in able if task.wanted], return_when=FIRST_COMPLETED)
            continue
        left.remove(task)
        try:
            task.do()
            done.add(task.name)
        except Exception as error:
            if failed is None or isinstance(error, Interrupted):
                raise
            failed(task, error)
            lost.add(task.name)


def _loses(task: Task, lost: set[str]) -> bool:
    """True if a task needs what was lost, and so is lost itself; one that bears it, if all was."""
    if task.needs & lost and not (task.bears and task.needs - lost):
        lost.add(task.name)
    return task.name in lost


class _WhenAsked(Executor):
    """An executor that runs each call in the caller's thread, when its result is asked for."""

    def submit(self, fn, /, *args, **kwargs):
        return _Task(lambda: fn(*args, **kwargs))


class _Task(Future):
    def __init__(self, make):
        super().__init__()
        self._make = make

    def result(self, timeout=None):
        if not self.done():
            self.set_result(self._make())
        return super().result(timeout)
