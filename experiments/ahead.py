"""Programs that are compiled while others run.

    with ahead.compiling() as pool:
        wanted = pool.submit(lambda: jax.jit(f).lower(x).compile())
        ...                                                  # something else
        y = wanted.result()(x)

XLA compiles outside of Python's lock, so a machine with cores to spare has compiled what comes next
when what comes before is done. Tracing holds that lock: programs are traced one by one, within
`with ahead.tracing()`, so that the first need not wait until all are.

A machine with two cores has none to spare: there each thing is compiled when it is asked for, since
side by side both would take longer than one after the other. So it is with several processes, since
arrays of all of them are placed by all at once, in one order.
"""

import contextlib
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor

import jax

from gril_jax import parallel_map

__all__ = ["compiling", "tracing"]

_FEW = 4  # cores that one compiler and one training keep busy
_MOST = 8  # each compiler has threads of its own

_tracing = threading.RLock()


def tracing() -> contextlib.AbstractContextManager:
    """Held while a program is traced and lowered, and not while it is compiled."""
    return _tracing


@contextlib.contextmanager
def compiling() -> Iterator[Executor]:
    """A pool to compile in, in the order in which it is asked; half of the cores.

    What has not begun when the block ends, for whatever reason, is given up; what has is waited
    for, since a compiler cannot be stopped.
    """
    cores = parallel_map.cores()
    spare = cores >= _FEW and jax.process_count() == 1
    pool = ThreadPoolExecutor(min(_MOST, cores // 2), "compile") if spare else _WhenAsked()
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


class _WhenAsked(Executor):
    """Does in the caller's thread, when its result is asked for, what would be done in a pool."""

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
