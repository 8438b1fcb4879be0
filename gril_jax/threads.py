"""Maps a function over items in several threads, a few items ahead of the consumer.

    for frames in parallel_map(read_video, paths): ...

For work that leaves Python's lock, such as OpenCV's and a video codec's.
"""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

X, Y = TypeVar("X"), TypeVar("Y")

_MOST = 8  # threads, each with an item in memory


def cores() -> int:
    """Number of processor cores that this process may use, of those that the machine has."""
    if hasattr(os, "sched_getaffinity"):  # not on macOS
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def parallel_map(function: Callable[[X], Y], items: Iterable[X]) -> Iterator[Y]:
    """The results in order; an exception is raised in place of its result. Not more than one item
    a thread is begun before it is asked for, so that few are in memory."""
    jobs = min(_MOST, cores())
    with ThreadPoolExecutor(jobs) as pool:
        begun: deque[Future[Y]] = deque()
        try:
            for item in items:
                begun.append(pool.submit(function, item))
                if len(begun) > jobs:
                    yield begun.popleft().result()
            while begun:
                yield begun.popleft().result()
        finally:
            for future in begun:
                future.cancel()
