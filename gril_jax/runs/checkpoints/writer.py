"""Writes checkpoints in a thread while training goes on.

Only the copy to the host holds the training up. At most one checkpoint is being written at a time.
"""

import contextlib
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from gril_jax.runs.metric_rows import Mark

from . import checkpoint
from .state_leaves import host_copy


class CheckpointWriter:
    """Writes a state's checkpoints to one folder; closed by `with`, which waits for the last one.

    What goes wrong in the thread is raised by the next call of any function. The `keep` newest ones
    stay. `before` is called in the thread ahead of each, to bring to the disk what it counts on;
    `mark` says how far the metrics have come as a state is handed over.
    """

    def __init__(
        self,
        folder: Path,
        *,
        keep: int,
        before: Callable[[], None] = lambda: None,
        mark: Callable[[], Mark | None] = lambda: None,
    ):
        self.longest_stall_s = 0.0  # that `save` held its caller up, waiting for another left out
        self._folder, self._keep, self._before, self._mark = folder, keep, before, mark
        self._threads = ThreadPoolExecutor(max_workers=1, thread_name_prefix="checkpoint")
        self._last: Future[None] | None = None

    @property
    def busy(self) -> bool:
        """True while a checkpoint is being written."""
        if self._last is not None and self._last.done():
            self.wait()
        return self._last is not None

    def save(self, step: int, state: Any) -> None:
        """Copies the state, then writes it in the thread; waits for the one before if necessary."""
        self.wait()
        begun, metrics = time.monotonic(), self._mark()
        leaves = host_copy(state)
        self.longest_stall_s = max(self.longest_stall_s, time.monotonic() - begun)

        def write() -> None:
            self._before()
            checkpoint.write(self._folder, step, leaves, keep=self._keep, metrics=metrics)

        self._last = self._threads.submit(write)

    def wait(self) -> None:
        """Returns once nothing is being written."""
        last, self._last = self._last, None
        if last is not None:
            last.result()

    def __enter__(self) -> "CheckpointWriter":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        # What went wrong first is what counts.
        with contextlib.suppress(Exception) if kind else contextlib.nullcontext():
            self.wait()
        self._threads.shutdown()
