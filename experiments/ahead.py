"""Programs of a sweep that are compiled while others run.

    with ahead.compiling() as pool:
        wanted = pool.submit(lambda: jax.jit(f).lower(x).compile())
        ...                                                  # something else
        y = wanted.result()(x)

XLA compiles outside of Python's lock, so a machine with cores to spare has compiled what comes next
when what comes before is done.
"""

import contextlib
import os
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor

import jax

__all__ = ["compiling"]

_MOST = 8  # tracing holds Python's lock: more would only wait for each other


@contextlib.contextmanager
def compiling() -> Iterator[Executor]:
    """A pool to compile in, in the order in which it is asked; half of the machine's cores.

    What has not begun when the block ends, for whatever reason, is given up; what has is waited
    for, since a compiler cannot be stopped.
    """
    # Several processes compile what they run together one by one, so that all do in one order.
    jobs = 1 if jax.process_count() > 1 else max(1, min(_MOST, (os.cpu_count() or 1) // 2))
    pool = ThreadPoolExecutor(jobs, thread_name_prefix="compile")
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)
