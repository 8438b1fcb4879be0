"""The lock of a run's folder: a file `lock` with the id of the one process that writes there.

The kernel drops the lock with the process, however it ends; the file stays behind.
"""

import fcntl
import os
from pathlib import Path
from typing import TextIO

from gril_jax.errors import RunError


def take_lock(folder: Path, *, note: bool = True) -> TextIO:
    """Locks the file `lock` of a folder until it is closed, and notes this process's id in it; a
    RunError if a process has the lock, this one included."""
    lock = open(folder / "lock", "a+", encoding="utf-8")  # closed by the caller
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        lock.seek(0)
        holder = lock.read().strip() or "unknown"
        lock.close()
        raise RunError(
            f"{folder} is being written by process {holder}: wait for it or give another folder"
        ) from None
    if note:
        lock.truncate(0)
        lock.write(f"{os.getpid()}\n")
        lock.flush()
    return lock
